"""Damaged bytes into the decoders of the wire: what is accepted that was never sent, and how soon order
returns.

    .venv/bin/python benchmarks/fuzz_decoder.py [--blocks N] [--seed N] [--out FILE]

Each block is a packet that is damaged in one of the ways of `DAMAGE`, and two whole ones after it; one block
in ten comes in small pieces. An exception that escapes from a decoder ends the run. Printed as JSON:

* `blocks`, `damaged`: blocks, by kind of damage too;
* `reached_crc`: damaged packets whose CRC was looked at; `expected`: that many / 65536, what a CRC of 16
  bits lets pass when what arrives is arbitrary, the most that is to be expected;
* `wrong_bodies`: bodies let pass that were not sent; `wrong_messages`: messages handed out that were not
  sent;
* `first_lost`, `second_lost`: blocks after which the first or the second whole packet did not come back;
* `forged`: bodies damaged before a right CRC was made for them: how many were handed out, and refused why;
* `lines`: the same damage to lines of text, which have no CRC: only their loss is counted.
"""

import argparse
import json
import random
import time
from collections import Counter
from pathlib import Path

import numpy as np
from cobs import cobs

from softfuse.hardware.source.text_lines import TextFormat, TextLines
from softfuse.hardware.wire.decoder import Decoder
from softfuse.hardware.wire.description import Channel, Description, Layout, RawType
from softfuse.hardware.wire.message import (
    DescriptionMessage,
    Header,
    Message,
    SampleMessage,
    Unpacker,
    encode,
    pack,
)

CHANNELS = 20
POOL = 2000
DESCRIBE_EVERY = 100
CRC_VALUES = 65536


def pool_of(rng: random.Random) -> tuple[DescriptionMessage, list[Message]]:
    """The description of a device and what it sends: samples, and its description now and then."""
    names = [f"flow{k}_V" for k in range(CHANNELS)]
    kinds = [rng.choice(list(RawType)) for _ in names]
    channels = [Channel(name, kind, 0.5, 1.0) for name, kind in zip(names, kinds, strict=True)]
    description = Description("fuzzed", tuple(channels))
    layout, sent = Layout(description), []
    for sequence in range(POOL):
        header = Header(1, sequence, 10_000 * sequence)
        if sequence % DESCRIBE_EVERY == 0:
            sent.append(DescriptionMessage(header, description))
            continue
        values = np.array([rng.gauss(0.0, 100.0) if rng.random() < 0.95 else np.nan for _ in names])
        sent.append(SampleMessage(header, layout.number, layout.content(values)))
    return DescriptionMessage(Header(1, 0, 0), description), sent


def flipped(rng: random.Random, packet: bytes) -> bytes:
    """With 1 to 8 of its bits flipped."""
    damaged = bytearray(packet)
    for bit in rng.sample(range(8 * len(packet)), rng.randint(1, 8)):
        damaged[bit // 8] ^= 1 << bit % 8
    return bytes(damaged)


def truncated(rng: random.Random, packet: bytes) -> bytes:
    """Without some of its bytes, anywhere."""
    start = rng.randrange(len(packet))
    return packet[:start] + packet[start + rng.randint(1, len(packet)) :]


def inserted(rng: random.Random, packet: bytes) -> bytes:
    """With up to 20 bytes more, anywhere before its end."""
    at = rng.randrange(len(packet))
    return packet[:at] + rng.randbytes(rng.randint(1, 20)) + packet[at:]


def burst(rng: random.Random, packet: bytes) -> bytes:
    """With up to 16 bytes overwritten."""
    at = rng.randrange(len(packet))
    size = min(rng.randint(1, 16), len(packet) - at)
    noise = bytes(byte ^ rng.randint(1, 255) for byte in packet[at : at + size])
    return packet[:at] + noise + packet[at + size :]


def noise(rng: random.Random, packet: bytes) -> bytes:
    """As many bytes that have nothing to do with it."""
    return rng.randbytes(len(packet))


def stuffed_noise(rng: random.Random, packet: bytes) -> bytes:
    """As many arbitrary bytes in faultless COBS: only the CRC can tell."""
    return cobs.encode(rng.randbytes(len(packet))) + b"\0"


DAMAGE = (flipped, truncated, inserted, burst, noise, stuffed_noise)


def pieces(rng: random.Random, data: bytes) -> list[bytes]:
    """Mostly all at once, sometimes in pieces of up to 9 bytes."""
    if rng.random() < 0.9:
        return [data]
    cut, at = [], 0
    while at < len(data):
        size = rng.randint(1, 9)
        cut.append(data[at : at + size])
        at += size
    return cut


def fuzz_packets(blocks: int, seed: int) -> dict[str, object]:
    """Damaged packets into `Decoder` and `Unpacker`."""
    rng = random.Random(seed)
    description, sent = pool_of(rng)
    bodies = [encode(message) for message in sent]
    packets = [pack(body) for body in bodies]
    known_messages, known_bodies = set(sent), set(bodies)
    decoder, unpacker = Decoder(), Unpacker()
    damaged: Counter[str] = Counter()
    lost: Counter[str] = Counter()
    wrong_bodies = wrong_messages = 0
    for block in range(blocks):
        if block % DESCRIBE_EVERY == 0:
            # A wrong description, should one pass, must not leave the rest of the run without values.
            decoder.feed(b"\0" + pack(encode(description)), 0.0)
            unpacker.feed(b"\0")
        damage = rng.choice(DAMAGE)
        damaged[damage.__name__] += 1
        first, second = rng.randrange(POOL), rng.randrange(POOL)
        data = damage(rng, packets[rng.randrange(POOL)]) + packets[first] + packets[second]
        messages = []
        for piece in pieces(rng, data):
            messages += [received.message for received in decoder.feed(piece, 0.0)]
        wrong_messages += sum(message not in known_messages for message in messages)
        wrong_bodies += sum(body not in known_bodies for body in unpacker.feed(data))
        lost["second"] += messages[-1:] != [sent[second]]
        lost["first"] += sent[first] not in messages[:-1]
    reached_crc = unpacker.counts.crc_failures + wrong_bodies
    return {
        "blocks": blocks,
        "damaged": dict(damaged),
        "reached_crc": reached_crc,
        "expected": reached_crc / CRC_VALUES,
        "wrong_bodies": wrong_bodies,
        "wrong_messages": wrong_messages,
        "first_lost": lost["first"],
        "second_lost": lost["second"],
        "undescribed": decoder.counts.undescribed,
    }


def fuzz_forged(blocks: int, seed: int) -> dict[str, int]:
    """Bodies that were damaged before they got a right CRC, into a `Decoder`."""
    rng = random.Random(seed)
    _, sent = pool_of(rng)
    bodies = [encode(message) for message in sent]
    described = [body for body in bodies if body[1] == 1]
    decoder = Decoder()
    handed_out = 0
    for _ in range(blocks):
        body = rng.choice(described if rng.random() < 0.3 else bodies)
        handed_out += len(decoder.feed(pack(rng.choice(DAMAGE)(rng, body)), 0.0))
    counts = decoder.counts
    refused = {name: getattr(counts, name) for name in ("malformed", "unknown_version", "unknown_kind")}
    return {"blocks": blocks, "packets": counts.line.packets, "handed_out": handed_out, **refused}


def fuzz_lines(blocks: int, seed: int) -> dict[str, int]:
    """Damaged lines into the driver of boards that print them."""
    rng = random.Random(seed)
    columns = tuple(f"v{k}" for k in range(CHANNELS))
    driver = TextLines(TextFormat(("time_us", *columns), "time_us"), {name: name for name in columns})
    second_lost = 0
    for block in range(blocks):
        lines = [
            b"%d," % (30_000 * block + 10_000 * k)
            + b",".join(b"%.3f" % rng.random() for _ in columns)
            + b"\n"
            for k in range(3)
        ]
        data = rng.choice(DAMAGE)(rng, lines[0]) + lines[1] + lines[2]
        readings = [one for piece in pieces(rng, data) for one in driver.feed(piece, 0.0)]
        second_lost += not readings or readings[-1].device_time_us != 30_000 * block + 20_000
    return {"blocks": blocks, "second_lost": second_lost, **driver.counts}


def main() -> None:
    """Runs the fuzz and prints its counts."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--blocks", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    start = time.perf_counter()
    result = {
        **fuzz_packets(arguments.blocks, arguments.seed),
        "forged": fuzz_forged(arguments.blocks // 4, arguments.seed),
        "lines": fuzz_lines(arguments.blocks // 20, arguments.seed),
    }
    result["seconds"] = round(time.perf_counter() - start, 1)
    text = json.dumps(result, indent=2)
    print(text)
    if arguments.out:
        arguments.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
