"""Frames of one length that begin with one byte, found in any stream of bytes.

The byte may stand within a frame too. So a candidate is a frame only if its check passes; if not, the search
goes on with the byte after its first.
"""

from collections.abc import Callable


class FixedFrames:
    """Finds frames in a stream that comes in pieces of any size; holds less than one frame."""

    def __init__(self, start: int, size: int, check: Callable[[bytes], bool]) -> None:
        self._start = bytes([start])
        self._size = size
        self._check = check
        self._partial = bytearray()
        # Whether the byte before was the last of a frame, so that a frame must follow.
        self._in_step = False
        self.found = 0
        """Frames whose check passed."""
        self.failures = 0
        """How often no frame followed on a frame."""
        self.bytes_discarded = 0
        """Bytes that are in no frame."""

    def feed(self, data: bytes) -> list[bytes]:
        """The frames that end in the next bytes of the stream, in order."""
        self._partial += data
        frames = []
        at = 0
        while True:
            begin = self._partial.find(self._start, at)
            if begin < 0:
                begin = len(self._partial)
            self._discard(begin - at)
            at = begin
            frame = bytes(self._partial[at : at + self._size])
            if len(frame) < self._size:
                break
            if self._check(frame):
                frames.append(frame)
                self._in_step = True
                at += self._size
            else:
                self._discard(1)
                at += 1
        del self._partial[:at]
        self.found += len(frames)
        return frames

    def interrupted(self) -> None:
        """Forget a frame that has begun, since the stream was cut."""
        self.bytes_discarded += len(self._partial)
        self._partial.clear()
        self._in_step = False

    def _discard(self, count: int) -> None:
        if count:
            self.bytes_discarded += count
            self.failures += self._in_step
            self._in_step = False
