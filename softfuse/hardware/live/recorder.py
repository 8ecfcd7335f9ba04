"""Writes a session to disk on a thread of its own, so that no disk can stall the loop.

What is to be written waits in a bounded queue. While the disk keeps writing, whoever finds the queue full
waits for it a little; once it does not, entries are counted as lost and told. A file that could not be
written on is complete up to there, and the recording goes on in another one beside it as soon as the disk
takes it.
"""

import queue
import threading
from collections.abc import Callable
from pathlib import Path

from softfuse.errors import RecordingError
from softfuse.hardware.record.entries import Entry, SessionInfo
from softfuse.hardware.record.session_writer import SessionWriter
from softfuse.hardware.stream import HostClock, Level, Notice

QUEUE_LENGTH = 20_000
"""What may wait to be written [entries]: a minute at 100 Hz."""
FLUSH_S = 0.25
"""How often what was written is handed to the operating system when nothing comes [s]."""
STUCK_S = 0.25
"""A disk that has written nothing for so long is not waited for [s]."""


class Recorder:
    """Takes everything that a session makes, from any thread, and never blocks."""

    def __init__(
        self,
        path: Path,
        info: SessionInfo,
        clock: HostClock,
        tell: Callable[[Notice], None],
        *,
        retry_s: float = 5.0,
    ):
        """Open the file, and start the thread that writes it.

        `tell` is called from that thread with what people should know; `retry_s` [s]: how often another file
        is tried after one failed. Raises RecordingError when the file exists or cannot be made.
        """
        self._path, self._info, self._clock, self._tell = path, info, clock, tell
        self._retry_s = retry_s
        self._writer: SessionWriter | None = SessionWriter(path, info)
        self._files, self._refused, self._missed = 1, 0, 0
        self._wrote_s = clock.now_s()
        self._queue: queue.Queue[Entry | None] = queue.Queue(QUEUE_LENGTH)
        self._thread = threading.Thread(target=self._run, name="softfuse recorder", daemon=True)
        self._thread.start()

    @property
    def lost(self) -> int:
        """Entries that are in no file."""
        return self._refused + self._missed

    def put(self, entry: Entry) -> None:
        """Record an entry; waits for a disk that is behind but writing."""
        try:
            if self._clock.now_s() - self._wrote_s < STUCK_S:
                self._queue.put(entry, timeout=STUCK_S)
            else:
                self._queue.put_nowait(entry)
        except queue.Full:
            self._refused += 1

    def close(self) -> None:
        """Write what waits and close the file."""
        self._queue.put(None)
        self._thread.join()

    def _run(self) -> None:
        told, tried = 0, self._clock.now_s()
        while True:
            try:
                entry = self._queue.get(timeout=FLUSH_S)
            except queue.Empty:
                self._attempt(SessionWriter.flush)
                continue
            if entry is None:
                break
            now = self._clock.now_s()
            if self._writer is None and now - tried >= self._retry_s:
                tried = now
                self._reopen()
            if self._writer is None:
                self._missed += 1
            elif not self._attempt(lambda writer, entry=entry: writer.add(entry)):
                tried = now
            if self._refused > told and self._queue.qsize() < QUEUE_LENGTH // 2:
                told = self._refused
                self._say("error", f"the disk is too slow: {told} entries were not recorded")
        self._attempt(SessionWriter.close)

    def _attempt(self, act: Callable[[SessionWriter], None]) -> bool:
        if self._writer is None:
            return False
        try:
            act(self._writer)
            self._wrote_s = self._clock.now_s()
        except OSError as error:
            # The writer has closed the file after its last whole chunk.
            self._missed += self._writer.pending
            self._say("error", f"recording stopped, estimation goes on: {error.strerror or error}")
            self._writer = None
            return False
        return True

    def _reopen(self) -> None:
        path = self._path.with_stem(f"{self._path.stem}-{self._files + 1}")
        try:
            self._writer = SessionWriter(path, self._info)
        except RecordingError:
            return
        self._files += 1
        self._say("warning", f"recording goes on in {path.name}; {self.lost} entries are in no file")

    def _say(self, level: Level, text: str) -> None:
        self._tell(Notice(self._clock.now_s(), None, level, text))
