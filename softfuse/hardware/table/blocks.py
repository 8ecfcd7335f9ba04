"""The text of a file, .gz or not, in blocks of whole lines, as UTF-8 whatever it is written in."""

import codecs
import gzip
import logging
import zlib
from collections.abc import Iterator
from contextlib import closing
from io import BufferedReader
from pathlib import Path

from softfuse.errors import RecordingError

logger = logging.getLogger(__name__)

HEAD = 1 << 18
"""Bytes of the first block, which tells how the file is written."""
BLOCK = 1 << 21
LONGEST_LINE = 1 << 17
_BOMS = (
    *((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32")),
    *((codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16")),
)
_AT_ONCE = 1 << 13
"""Bytes that a damage may cost."""
_ZEROS_OF_UTF16 = 0.4


class TextBlocks:
    """A text file to be gone through once.

    Raises RecordingError when it cannot be opened, is no text, or (while going through it) a line is too long
    for any table.
    """

    def __init__(self, path: Path, encoding: str | None):
        """encoding: Python's name for how it is written; None: it is found."""
        self.path, self.complete = path, True
        try:
            # Closed by whoever has gone through it.
            self._stream = gzip.open(path, "rb") if path.suffix == ".gz" else path.open("rb")  # noqa: SIM115
        except OSError as error:
            raise RecordingError(f"cannot open the recording {path}: {error.strerror or error}") from error
        self._encoding = encoding

    def __iter__(self) -> Iterator[bytes]:
        """The blocks, each of which ends with a line's end."""
        rest, counted = b"", 1
        for piece in self._pieces():
            end = piece.rfind(b"\n") + 1
            block, rest = rest + piece[:end], (piece[end:] if end else rest + piece)
            longest = max(map(len, block.split(b"\n"))) if len(block) > LONGEST_LINE else 0
            if max(longest, len(rest)) > LONGEST_LINE:
                raise RecordingError(
                    f"{self.path} is no table of numbers: after line {counted} comes one of more than "
                    f"{LONGEST_LINE} bytes"
                )
            if end:
                counted += block.count(b"\n")
                yield block
        if rest:
            yield rest + b"\n"

    def _pieces(self) -> Iterator[bytes]:
        with closing(self._stream) as stream:
            head = self._read(stream, HEAD)
            if head.startswith(b"PK\x03\x04"):
                raise RecordingError(f"{self.path} is no text but an archive or a workbook: export it as CSV")
            encoding = self._encoding or _encoding(head)
            utf8 = codecs.lookup(encoding).name == "utf-8"
            decoder = codecs.getincrementaldecoder(encoding)(errors="replace")
            # UTF-8 as it is: whole lines stay whole, and what is damaged is the reader's to judge.
            first = head if utf8 else decoder.decode(head).encode()
            old_mac = b"\n" not in first and b"\r" in first
            piece = first
            while piece:
                yield piece.replace(b"\r", b"\n") if old_mac else piece
                raw = self._read(stream, BLOCK)
                piece = raw if utf8 else decoder.decode(raw, final=not raw).encode()

    def _read(self, stream: "BufferedReader | gzip.GzipFile", count: int) -> bytes:
        """So many bytes, fewer at the end; what comes before a damage is kept."""
        pieces, left = list[bytes](), count
        try:
            while left > 0 and (piece := stream.read1(min(left, _AT_ONCE))):
                pieces.append(piece)
                left -= len(piece)
        except gzip.BadGzipFile as error:
            if not pieces and stream.tell() == 0:
                raise RecordingError(f"{self.path} is not a gzip file: {error}") from error
            self._cut(error)
        except (EOFError, OSError, zlib.error) as error:
            self._cut(error)
        return b"".join(pieces)

    def _cut(self, error: Exception) -> None:
        if self.complete:
            logger.warning("%s ends early: %s", self.path, error)
        self.complete = False


def _encoding(head: bytes) -> str:
    for mark, name in _BOMS:
        if head.startswith(mark):
            return name
    half = max(len(head) // 2, 1)
    for name, zeros in (("utf-16-le", head[1::2].count(0)), ("utf-16-be", head[0::2].count(0))):
        if zeros > _ZEROS_OF_UTF16 * half:
            return name
    try:
        head.decode()
    except UnicodeDecodeError as error:
        # A header in UTF-8 above damaged rows stays what it is; one without any sign of it may be either.
        if error.end < len(head) and head[: error.start].isascii():
            return "cp1252"
    return "utf-8"
