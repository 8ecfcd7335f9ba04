"""softfuse_wire.h as C99 and as C++11, byte for byte against the host's encoder."""

import shutil
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import (
    AskMessage,
    DescriptionMessage,
    Header,
    SampleMessage,
    TextMessage,
    encode,
    pack,
)

FIRMWARE = Path(__file__).parents[2] / "scripts" / "firmware"
HARNESS = Path(__file__).parent / "firmware" / "wire_harness.c"
STRICT = (
    "-Wall",
    "-Wextra",
    "-Wpedantic",
    "-Wconversion",
    "-Wshadow",
    "-Werror",
    "-fsanitize=undefined,address",
)
COMPILERS = {"c99": ("gcc", "-std=c99"), "c++11": ("g++", "-std=c++11", "-x", "c++")}

Harness = Callable[[list[str]], list[str]]


@pytest.fixture(scope="module", params=sorted(COMPILERS))
def harness(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Harness:
    """Runs the harness on lines of input; lines of output."""
    compiler, *options = COMPILERS[request.param]
    assert shutil.which(compiler), f"{compiler} is needed to test the firmware: apt install gcc g++"
    binary = tmp_path_factory.mktemp("harness") / "harness"
    command = [compiler, *options, *STRICT, "-I", str(FIRMWARE), str(HARNESS), "-o", str(binary)]
    compiled = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert compiled.returncode == 0, compiled.stderr

    def run(lines: list[str]) -> list[str]:
        text = "".join(line + "\n" for line in lines)
        done = subprocess.run([binary], input=text, capture_output=True, text=True, timeout=30)
        assert done.returncode == 0, done.stderr
        return done.stdout.splitlines()

    return run


def single(number: float) -> str:
    """The bits of a 32 bit float."""
    return f"{struct.unpack('<I', struct.pack('<f', number))[0]:x}"


def device_line(number: int, description: Description) -> str:
    """Tells the harness of a device."""
    channels = [
        f"{c.type.value:x} {single(c.scale)} {single(c.offset)} {c.name.encode().hex()}"
        for c in description.channels
    ]
    name = description.name.encode().hex()
    return " ".join([f"device {number:x} {name} {len(channels):x}", *channels])


def sample_line(message: SampleMessage, description: Description) -> tuple[str, SampleMessage]:
    """Tells the harness of a sample, and the sample that it makes: what was not read is 0 there."""
    size = (len(description.channels) + 7) // 8
    presence, at, words, raws = message.content[:size], size, [], b""
    for k, channel in enumerate(description.channels):
        raw = message.content[at : at + channel.type.size]
        at += channel.type.size
        read = presence[k // 8] >> (k % 8) & 1
        words.append(f"{int.from_bytes(raw, 'little'):x}" if read else "-")
        raws += raw if read else bytes(len(raw))
    header = message.header
    line = " ".join([f"sample {header.sequence:x} {header.time_us:x}", *words])
    return line, SampleMessage(header, message.layout, presence + raws)


def arbitrary(rng: np.random.Generator) -> tuple[int, Description, list[SampleMessage]]:
    """A device of 1 to 40, sometimes 512 channels, and samples of it."""
    count = 512 if rng.random() < 0.05 else int(rng.integers(1, 41))
    channels = [
        Channel(
            f"{'é' * int(rng.integers(0, 3))}c{k}_V",
            RawType(int(rng.integers(1, 9))),
            float(rng.normal()) or 1.0,
            float(rng.normal()),
        )
        for k in range(count)
    ]
    description = Description(f"device {rng.integers(100)}", tuple(channels))
    number, samples = int(rng.integers(0, 65535)), []
    for _ in range(5):
        header = Header(number, int(rng.integers(2**32)), int(rng.integers(2**63)) * 2 + 1)
        present = int.from_bytes(rng.bytes((count + 7) // 8), "little") | -(rng.random() < 0.5)
        bits = (present & ((1 << count) - 1)).to_bytes((count + 7) // 8, "little")
        size = Layout(description).size - len(bits)
        # All kinds of runs without zeros, around the 254 bytes of a block of COBS too.
        raw = bytes(size) if rng.random() < 0.2 else rng.bytes(size)
        raw = raw.replace(b"\0", b"\1") if rng.random() < 0.5 else raw
        samples.append(SampleMessage(header, description.layout(), bits + raw))
    return number, description, samples


def test_descriptions_and_samples_are_those_of_the_host(harness):
    rng = np.random.default_rng(0)
    lines, expected = [], []
    for _ in range(150):
        number, description, samples = arbitrary(rng)
        lines.append(device_line(number, description))
        expected.append(DescriptionMessage(Header(number, 0, 0), description))
        for sample in samples:
            line, message = sample_line(sample, description)
            lines.append(line)
            expected.append(message)
    assert harness(lines) == [pack(encode(message)).hex() for message in expected]


@pytest.mark.parametrize(
    "size", [0, 1, 234, 235, 236, 237, 238, 253, 254, 255, 489, 490, 491, 492, 700, 16368]
)
def test_texts_of_every_length_around_the_blocks_of_cobs(harness, size):
    header = Header(0x0101, 0x01010101, 0x0101010101010101)
    device = device_line(0x0101, Description("d", (Channel("c", RawType.U8, 1.0, 0.0),)))
    text = "x" * size
    *_, line = harness([device, f"text {header.sequence:x} {header.time_us:x} {text.encode().hex()}"])
    assert line == pack(encode(TextMessage(header, text))).hex()


def test_a_buffer_of_the_stated_size_suffices_and_one_that_does_not_gives_nothing(harness):
    one = Description("d", (Channel("c", RawType.U8, 1.0, 0.0),))
    header = Header(0x0101, 0x01010101, 0x0101010101010101)
    sizes = [*range(0, 8), *range(230, 245), *range(485, 500), 16368]
    lines, expected = (
        [device_line(0x0101, one)],
        [pack(encode(DescriptionMessage(Header(0x0101, 0, 0), one)))],
    )
    for size in sizes:
        packet = pack(encode(TextMessage(header, "x" * size)))
        body = 16 + size
        stated = body + 5 + (body + 2) // 254
        for room in (stated, len(packet), len(packet) - 1, 10, 0):
            lines += [
                f"room {room:x}",
                f"text {header.sequence:x} {header.time_us:x} {('x' * size).encode().hex()}",
            ]
            expected.append(packet if room >= stated else None)
    for packet, line in zip(expected, harness(lines), strict=True):
        # Without the spare byte it may fit or not, but is never cut.
        assert line == packet.hex() if packet else line in ("", pack(b"")) or bytes.fromhex(line)[-1] == 0


@pytest.mark.parametrize(
    "lines",
    [
        ["sample 0 0 1 2"],
        [device_line(1, Description("d", (Channel("c", RawType.U8, 1.0, 0.0),))), "sample 0 0 1 2"],
        [device_line(1, Description("d", (Channel("c", RawType.U8, 1.0, 0.0),))), "sample 0 0"],
        ["device 1 64 0"],
        ["device 1 64 1 1 3f800000 0 " + "61" * 256],
        ["device 1 64 1 9 3f800000 0 61", "sample 0 0 -"],
    ],
    ids=["undescribed", "too many", "too few", "no channels", "long name", "unknown type"],
)
def test_what_is_not_as_described_gives_no_packet(harness, lines):
    assert harness(lines)[-1] == ""


def test_only_a_question_to_this_device_or_all_is_heard(harness):
    def ask(device: int) -> bytes:
        return pack(encode(AskMessage(Header(device, 0, 0))))

    wrong_crc = bytearray(ask(7))
    wrong_crc[-2] ^= 1
    text = pack(encode(TextMessage(Header(7, 0, 0), "")))
    for stream, heard in [
        (ask(7), 1), (ask(65535), 1), (ask(8), 0), (b"\0" + ask(7) + ask(7), 2), (bytes(wrong_crc), 0),
        (text, 0), (bytes(wrong_crc) + ask(7), 1), (b"boot" + ask(7), 0), (b"boot" + ask(7) * 2, 1),
        (ask(7)[:-1], 0),
        (pack(bytes([1] * 300)) + ask(7), 1), (pack(bytes(300)) + ask(7), 1),
    ]:  # fmt: skip
        device = device_line(7, Description("d", (Channel("c", RawType.U8, 1.0, 0.0),)))
        *_, line = harness([device, f"asked {stream.hex()}"])
        assert len(line) == len(stream) and line.count("1") == heard
        # At the 0x00 that ends it.
        assert all(stream[k] == 0 for k, sign in enumerate(line) if sign == "1")


def test_any_damaged_question_is_harmless(harness):
    rng = np.random.default_rng(1)
    ask = pack(encode(AskMessage(Header(7, 0, 0))))
    stream = b""
    for _ in range(700):
        bad = bytearray(ask)
        bad[rng.integers(len(bad) - 1)] ^= int(rng.integers(1, 256))
        stream += bytes(bad) + rng.bytes(3).replace(b"\0", b"\1") + b"\0"
    device = device_line(7, Description("d", (Channel("c", RawType.U8, 1.0, 0.0),)))
    *_, line = harness([device, f"asked {(stream + ask).hex()}"])
    assert line.endswith("1") and line.count("1") <= 2


def test_a_counter_of_32_bits_is_carried_on(harness):
    counter = [5, 5, 2**32 - 1, 0, 7, 3]
    (line,) = harness(["extend " + " ".join(f"{time:x}" for time in counter)])
    expected = [5, 5, 2**32 - 1, 2**32, 2**32 + 7, 2**33 + 3]
    assert [int(word, 16) for word in line.split()] == expected
