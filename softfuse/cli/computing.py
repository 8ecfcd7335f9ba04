"""How the commands compute: in double precision, with compiled programs kept from run to run."""

import logging
import os

import platformdirs

log = logging.getLogger(__name__)


def prepare_jax() -> None:
    """Enable float64, and keep compiled programs in the user's cache folder unless JAX was given another.

    JAX_ENABLE_COMPILATION_CACHE=0 in the environment turns the keeping off.
    """
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
