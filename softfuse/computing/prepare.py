"""How the commands compute: in double precision, with compiled programs kept from run to run."""

import ctypes
import logging
import os
import sys

import platformdirs

log = logging.getLogger(__name__)


_LARGEST_C_INT = 2**31 - 1
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
"""glibc's M_TRIM_THRESHOLD and M_MMAP_THRESHOLD: sizes from which freed memory goes back to the system."""


def prepare_jax() -> None:
    """Enable float64, and keep compiled programs in the user's cache folder unless JAX was given another;
    memory that was freed is kept too.

    JAX_ENABLE_COMPILATION_CACHE=0 in the environment turns the keeping of programs off.
    """
    _keep_freed_memory()
    import jax

    jax.config.update("jax_enable_x64", True)
    # A frame is waited for anyway; on a thread of its own it would only begin later.
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    if "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS" not in os.environ:
        # The many small programs of a start take longer to compile than to read.
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return
    folder = platformdirs.user_cache_path("softfuse") / "jax"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        log.info("compiled programs are not kept, %s cannot be made: %s", folder, error.strerror)
    else:
        jax.config.update("jax_compilation_cache_dir", str(folder))


def _keep_freed_memory() -> None:
    # Large arrays come and go in every frame: got from the system each time, page by page, they took a fifth
    # of the time of estimates on a full body.
    if not sys.platform.startswith("linux"):
        return
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None or "MALLOC_MMAP_THRESHOLD_" in os.environ:
        return
    for which in (_MMAP_THRESHOLD, _TRIM_THRESHOLD):
        if not mallopt(which, _LARGEST_C_INT):
            log.info("the C library does not keep freed memory")
