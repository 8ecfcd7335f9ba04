"""A virtual device that serves in a thread of its own."""

import threading
from collections.abc import Sequence

from softfuse.hardware.virtual.faults import Outages
from softfuse.hardware.virtual.serving import Pace, VirtualDevice, VirtualPort, in_real_time


class Served:
    """Serves ports from `start`, which comes back when they are open, to `stop`."""

    def __init__(
        self, ports: Sequence[VirtualPort], pace: Pace = in_real_time, *, outages: Outages | None = None
    ) -> None:
        self._opened = threading.Event()
        self._device = VirtualDevice(ports, pace, outages=outages, plugged=lambda _: self._opened.set())
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._failure: BaseException | None = None

    def start(self) -> None:
        """Raises what the serving fails with before the ports are open."""
        self._thread.start()
        self._opened.wait()
        if self._failure is not None:
            raise self._failure

    def stop(self) -> None:
        """Raises what the serving has failed with."""
        self._device.stop()
        if self._thread.is_alive():
            self._thread.join()
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        try:
            self._device.run()
        except BaseException as failure:
            self._failure = failure
        finally:
            self._opened.set()
