"""The driver of the binary protocol."""

import numpy as np

from softfuse.hardware.source.softfuse_frames import SoftfuseFrames
from softfuse.hardware.wire.decoder import Decoder
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

PAD = Layout(Description("pad", tuple(Channel(f"flow{k}_V", RawType.F32, 1.0, 0.0) for k in range(3))))
OTHER = Layout(Description("pad", (Channel("row0", RawType.U16, 1.0, 0.0),)))


def described(layout: Layout, device: int = 7) -> bytes:
    return pack(encode(DescriptionMessage(Header(device, 0, 0), layout.description)))


def sample(layout: Layout, sequence: int, values: list[float], device: int = 7) -> bytes:
    content = layout.content(np.array(values))
    return pack(encode(SampleMessage(Header(device, sequence, 10 * sequence), layout.number, content)))


def questions(data: bytes) -> list[int]:
    """Who is asked."""
    messages = [one.message for one in Decoder().feed(data, 0.0)]
    assert all(isinstance(message, AskMessage) for message in messages)
    return [message.header.device for message in messages]


def test_samples_become_readings_with_the_names_of_their_description():
    driver = SoftfuseFrames()
    first, second = driver.feed(
        described(PAD) + sample(PAD, 4, [1.0, np.nan, 3.0]) + described(OTHER) + sample(OTHER, 5, [9.0]), 2.5
    )
    assert (first.device, first.sequence, first.device_time_us, first.host_s) == (7, 4, 40, 2.5)
    assert first.names == ("flow0_V", "flow1_V", "flow2_V")
    np.testing.assert_array_equal(first.values, [1.0, np.nan, 3.0])
    assert (second.sequence, second.names, second.values.tolist()) == (5, ("row0",), [9.0])
    assert driver.counts["samples"] == 2


def test_everybody_is_asked_at_first_and_who_is_unknown_again_but_not_for_each_sample():
    driver = SoftfuseFrames()
    (greeting,) = driver.greeting()
    assert questions(greeting) == [65535]
    assert driver.feed(sample(PAD, 0, [1, 2, 3]) + sample(PAD, 1, [1, 2, 3]), 10.0) == []
    assert questions(driver.take_requests()) == [7]
    assert driver.take_requests() == b""
    driver.feed(sample(PAD, 2, [1, 2, 3]), 10.3)
    assert driver.take_requests() == b""
    driver.feed(sample(PAD, 3, [1, 2, 3]), 10.6)
    assert questions(driver.take_requests()) == [7]
    assert (driver.counts["samples"], driver.counts["samples not described"]) == (0, 4)


def test_what_devices_say_is_told_and_what_they_print_without_end_is_not():
    driver = SoftfuseFrames()
    text = pack(encode(TextMessage(Header(7, 0, 0), "calibrated\x1b[2J")))
    driver.feed(described(PAD) + text + described(PAD), 1.0)
    assert [(n.host_s, n.source, n.level, n.text) for n in driver.take_notices()] == [
        (1.0, None, "info", "device 7 is 'pad', with 3 channels"),
        (1.0, None, "info", "device 7: calibrated\x1b[2J"),
    ]
    assert driver.take_notices() == []
    driver.feed(text * 1000, 2.0)
    assert len(driver.take_notices()) == 10
    assert driver.counts["remarks left out"] == 990


def test_half_a_packet_is_forgotten_at_an_interruption_and_descriptions_are_not():
    driver = SoftfuseFrames()
    driver.feed(described(PAD) + sample(PAD, 0, [1, 2, 3])[:-5], 0.0)
    driver.interrupted()
    (reading,) = driver.feed(sample(PAD, 1, [4, 5, 6]), 1.0)
    assert (reading.sequence, reading.values.tolist()) == (1, [4.0, 5.0, 6.0])
    assert driver.counts["CRC failures"] == driver.counts["COBS failures"] == 0


def test_the_names_of_many_devices_do_not_pile_up():
    driver = SoftfuseFrames()
    for device in range(200):
        driver.feed(described(PAD, device) + sample(PAD, 0, [1, 2, 3], device), 0.0)
    assert driver.counts["samples"] == 200
    assert driver.feed(sample(PAD, 1, [1, 2, 3], 0), 1.0) == []
    assert driver.feed(sample(PAD, 1, [1, 2, 3], 199), 1.0) != []
