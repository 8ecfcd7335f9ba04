"""The Arduino sketches, compiled for this computer and run on a board of the test's; read as a host would."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.hardware.wire.decoder import Decoder, Received
from softfuse.hardware.wire.message import (
    AskMessage,
    DescriptionMessage,
    Header,
    SampleMessage,
    TextMessage,
    encode,
    pack,
)
from softfuse.hardware.wire.sequence import Arrival, SequenceWatch
from softfuse.robot.file import load

ROOT = Path(__file__).parents[2]
FIRMWARE = ROOT / "scripts" / "firmware"
BOARD = Path(__file__).parent / "firmware"
STRICT = ("-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsanitize=undefined,address")
SKETCHES = ("pad", "finger")

Run = Callable[..., tuple[Decoder, list[Received]]]


@pytest.fixture(scope="module", params=SKETCHES)
def sketch(request: pytest.FixtureRequest) -> str:
    """The sketch's name."""
    return request.param


@pytest.fixture(scope="module")
def run(sketch: str, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Runs the sketch for some seconds of its own time; what the host's decoder makes of what it sends."""
    assert shutil.which("g++"), "g++ is needed to test the firmware: apt install g++"
    binary = tmp_path_factory.mktemp(sketch) / sketch
    sources = [
        "-include",
        "Arduino.h",
        "-x",
        "c++",
        str(FIRMWARE / sketch / f"{sketch}.ino"),
        str(BOARD / "board.cpp"),
    ]
    command = ["g++", *STRICT, "-I", str(BOARD), "-I", str(FIRMWARE), *sources, "-o", str(binary)]
    compiled = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert compiled.returncode == 0, compiled.stderr

    def execute(
        seconds: float, *, start_us: int = 0, silent_s: tuple[float, float] = (0.0, 0.0), host: bytes = b""
    ) -> tuple[Decoder, list[Received]]:
        arguments = [str(seconds), str(start_us), *map(str, silent_s), host.hex()]
        done = subprocess.run([binary, *arguments], capture_output=True, timeout=30)
        assert done.returncode == 0, done.stderr
        decoder = Decoder()
        # As if a bootloader had printed something before.
        return decoder, decoder.feed(b"Boot v2\r\n" + done.stdout, 0.0)

    return execute


def samples_of(received: list[Received]) -> tuple[list[SampleMessage], np.ndarray]:
    """The samples, and their values (f, n)."""
    some = [(one.message, one.values) for one in received if isinstance(one.message, SampleMessage)]
    return [message for message, _ in some], np.array([values for _, values in some])


def channels_of(sketch: str) -> list[str]:
    """The channels of the configuration that the board has, in its order: those of electrodes first."""
    first, then = {"pad": ("crossed-diamonds", "flow"), "finger": ("electrodes", "pressure")}[sketch]
    sensors = {each.type: each for each in load(ROOT / "configs" / f"{sketch}.toml").sensors}
    return [*sensors[first].columns, *sensors[then].columns]


def test_channels_are_those_of_the_configuration(sketch, run):
    decoder, received = run(0.5)
    (description,) = decoder.descriptions.values()
    assert description.name == load(ROOT / "configs" / f"{sketch}.toml").robot.name
    assert list(description.names) == channels_of(sketch)
    assert isinstance(received[0].message, DescriptionMessage)
    assert decoder.counts.line.crc_failures + decoder.counts.line.cobs_failures == 1  # the bootloader
    assert decoder.counts.malformed == decoder.counts.undescribed == 0


def test_values_are_those_of_the_board(sketch, run):
    _, values = samples_of(run(0.5)[1])
    electrodes = {"pad": 16, "finger": 12}[sketch]
    chip, electrode = np.divmod(np.arange(electrodes), {"pad": 8, "finger": 12}[sketch])
    pins = {"pad": [0, 1, 2, 3], "finger": [0, 1, 2, 3, 6, 7]}[sketch]
    expected = [
        *(65535 - 64 * (700 - 10 * electrode - 200 * chip)),
        *(5 / 1024 * (100 + 50 * np.array(pins))),
    ]
    assert values.shape[0] > 40
    np.testing.assert_allclose(values, np.tile(expected, (values.shape[0], 1)), rtol=1e-7)


@pytest.mark.parametrize("start_us", [0, 2**32 - 2_500_000])
def test_samples_come_at_100_hz_and_descriptions_every_second(run, start_us):
    decoder, received = run(5.0, start_us=start_us)
    samples, _ = samples_of(received)
    watch = SequenceWatch()
    places = [watch.place(sample.header.sequence, sample.header.time_us) for sample in samples]
    assert all(place.arrival is Arrival.FRESH and place.missing == 0 for place in places)
    times = np.array([sample.header.time_us for sample in samples])
    assert (times[-1] - times[0]) / (len(times) - 1) == pytest.approx(10_000, abs=25)
    # The description that is sent in between delays a sample by up to 10 ms, not those after it.
    assert len(samples) >= 490 and np.median(np.diff(times)) == pytest.approx(10_000, abs=25)
    assert np.diff(times).max() < 20_100
    assert samples[0].header.sequence == 0 and times[0] > start_us
    described = [one.message for one in received if isinstance(one.message, DescriptionMessage)]
    assert len(described) == 5
    # A description carries the number of the next sample.
    kinds = [one.message for one in received]
    for now, later in zip(kinds, kinds[1:], strict=False):
        if isinstance(now, DescriptionMessage) and isinstance(later, SampleMessage):
            assert now.header.sequence == later.header.sequence


def test_a_question_is_answered(run):
    question = pack(encode(AskMessage(Header(65535, 0, 0))))
    others = pack(encode(AskMessage(Header(999, 0, 0))))
    _, received = run(0.9, host=b"\0" + others + question)
    described = [one.message for one in received if isinstance(one.message, DescriptionMessage)]
    assert len(described) == 2
    assert described[1].header.time_us == pytest.approx(500_000, abs=20_000)


def test_chips_that_do_not_answer_leave_their_channels_empty_until_they_do(sketch, run):
    _, received = run(5.5, silent_s=(1.5, 3.5))
    samples, values = samples_of(received)
    times = np.array([sample.header.time_us for sample in samples])
    electrodes = {"pad": 16, "finger": 12}[sketch]
    silent = np.isnan(values[:, :electrodes]).all(axis=1)
    assert not np.isnan(values[:, electrodes:]).any() and not np.isnan(values[~silent]).any()
    assert silent[(times > 1_520_000) & (times < 3_480_000)].all()
    # They are started again with the next description.
    assert not silent[times < 1_480_000].any() and not silent[times > 4_600_000].any()
    texts = [one.message.text for one in received if isinstance(one.message, TextMessage)]
    assert len(texts) == 2 and "check its wiring" in texts[0] and "check" not in texts[1]


def test_silence_from_the_start_is_told(run):
    _, received = run(1.5, silent_s=(0.0, 9.0))
    texts = [one.message.text for one in received if isinstance(one.message, TextMessage)]
    assert len(texts) == 1 and "does not answer" in texts[0]
