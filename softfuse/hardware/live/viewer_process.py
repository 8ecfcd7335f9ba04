"""Rerun's server, for as long as whoever started it lives.

Killed at once, a program cannot end what it has started. This process stands between: its standard input ends
with the program that holds the other end, however that ends, and then it ends the server.
"""

import os
import signal
import subprocess
import sys
import threading
import time

_ENDS_WITHIN_S = 10.0


def start_viewer(arguments: list[str]) -> "subprocess.Popen[bytes]":
    """Start Rerun with these arguments; it ends with this process, or with `end_viewer`."""
    return subprocess.Popen(
        [sys.executable, "-m", __name__, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        # Not interrupted together with who watches it, who has something to show until the end.
        start_new_session=True,
    )


def end_viewer(viewer: "subprocess.Popen[bytes]") -> None:
    """End what `start_viewer` has started; back when all of it has ended, or after `_ENDS_WITHIN_S`."""
    assert viewer.stdin is not None
    viewer.stdin.close()
    viewer.wait(_ENDS_WITHIN_S)
    deadline = time.monotonic() + _ENDS_WITHIN_S
    # The first of its group is gone, the server itself may take a moment longer.
    while _group_is_there(viewer.pid) and time.monotonic() < deadline:
        time.sleep(0.01)


def _group_is_there(number: int) -> bool:
    try:
        os.killpg(number, 0)
    except (ProcessLookupError, AttributeError):  # on Windows there are no groups of processes
        return False
    except PermissionError:
        # Ours may be signalled as long as one of it runs, so it has ended: macOS answers so until the last of
        # it are collected, and anywhere the number may already belong to others.
        return False
    return True


def main() -> int:
    """Run Rerun until it ends or the standard input does; its exit code."""
    server = subprocess.Popen([sys.executable, "-m", "rerun", *sys.argv[1:]], stdin=subprocess.DEVNULL)

    def watch() -> None:
        sys.stdin.buffer.read()
        try:
            # Rerun's module starts a program of its own: all three are one group.
            os.killpg(0, signal.SIGTERM)
        except AttributeError:  # on Windows there are no groups of processes
            server.terminate()

    threading.Thread(target=watch, daemon=True).start()
    return server.wait()


if __name__ == "__main__":
    raise SystemExit(main())
