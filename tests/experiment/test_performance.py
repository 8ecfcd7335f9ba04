"""What a virtual robot's channels say, as a programme for boards and as a recording, with the truth."""

from pathlib import Path

import numpy as np
import pytest
from made_robots import BEAM, BLOCK, settings_of

from softfuse.errors import ConfigError
from softfuse.experiment.performance import Performance, in_turn
from softfuse.experiment.recording_file import write_recording
from softfuse.experiment.timeline import Frames
from softfuse.experiment.virtual_robot import MakingErrors, VirtualRobot, virtual_robot
from softfuse.hardware.recording import read_recording

N = 400
TIME = np.arange(N) / 100.0
FORCE = 5.0 * np.sin(np.pi * TIME / 4.0) ** 2
TOP = np.array([0.0, 0.0, 17e-3])


@pytest.fixture(scope="module")
def block() -> VirtualRobot:
    return virtual_robot(settings_of(BLOCK), MakingErrors(nodes=0))


@pytest.fixture(scope="module")
def played(block: VirtualRobot) -> Performance:
    """A press that squeezes 10 mm³/N out of the right chamber, then nothing."""
    volume = np.stack([0.0 * FORCE, -1e-8 * FORCE], axis=1)
    episode = (TIME >= 3.5).astype(int)
    sample = np.where(np.arange(N) == 200, 1, 0)
    values = {
        "reading": volume,
        "volume": volume,
        "force": FORCE[:, None],
        "gap": -1e-4 * FORCE[:, None],
        "point": TOP - 1e-3 * np.outer(FORCE, [0, 0, 1])[:, None],
        "drive": np.zeros((N, 0)),
        "answer": np.zeros((N, 0)),
        "held": 0.0 * FORCE,
        "signal stage": np.stack([0 * FORCE + 10e-3, 0 * FORCE, FORCE], axis=1),
    }
    places = np.array([[[10e-3, 0.0, 18e-3]], [[np.nan] * 3]])
    return Performance(block, places, Frames(TIME, episode, sample, values))


def test_a_programme_says_what_nominal_sensors_do(played: Performance) -> None:
    programme = played.programme()
    assert programme.channels == ("flow0_V", "flow1_V", "x_mm", "y_mm", "force_N")
    flow = 1e-8 * np.gradient(FORCE, TIME)
    np.testing.assert_allclose(programme.readings[:, 1], 0.5 + 20 * 6e4 * flow, rtol=1e-9)
    np.testing.assert_allclose(programme.readings[:, 0], 0.5)
    np.testing.assert_allclose(
        programme.readings[:, 2:], np.stack([0 * FORCE + 10, 0 * FORCE, FORCE], axis=1)
    )
    assert programme.stepped == {"press", "sample"}
    assert len(played.electronics(1).noise) == 5


def test_truth_is_called_by_the_names_of_the_parts(played: Performance) -> None:
    truth = played.truth()
    assert list(truth) == [
        *("press", "sample", "true_x_mm", "true_y_mm", "true_z_mm", "true_force_N", "true_depth_mm"),
        *("true_top_x_mm", "true_top_y_mm", "true_top_z_mm", "true_left_mm3", "true_right_mm3"),
    ]
    assert truth["true_x_mm"][0] == 10.0 and truth["true_z_mm"][0] == 18.0
    assert np.isnan(truth["true_x_mm"][-1]) and truth["press"][-1] == 1
    np.testing.assert_allclose(truth["true_right_mm3"], -10 * FORCE)
    np.testing.assert_allclose(truth["true_top_z_mm"], 17 - FORCE)
    np.testing.assert_allclose(truth["true_depth_mm"], 0.1 * FORCE)


def test_a_recording_is_read_back_and_leaves_unknown_truth_blank(played: Performance, tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    columns = played.recording(3, 1)
    write_recording(path, columns)
    found = read_recording(path, list(played.robot.made.settings.channels))
    assert list(found.columns) == list(columns)
    np.testing.assert_allclose(found.time_s, TIME, atol=1e-9)
    for name in ("flow1_V", "force_N", "true_force_N"):
        np.testing.assert_allclose(found.columns[name], columns[name][1], atol=6e-6)
    assert np.isnan(found.columns["true_x_mm"][-1]) and found.columns["true_x_mm"][0] == 10.0
    assert not found.malformed[:300].any()


def test_the_body_decides_about_parts_and_the_other_seed_about_noise(played: Performance) -> None:
    one, same, noise, other = (
        played.recording(*seeds)["flow0_V"][1] for seeds in ((1, 1), (1, 1), (1, 2), (2, 1))
    )
    np.testing.assert_array_equal(one, same)
    assert (one != noise).mean() > 0.5 and abs(one[:50].mean() - noise[:50].mean()) < 1.5e-3
    assert abs(one[:50].mean() - other[:50].mean()) > 0.2e-3


def test_gains_of_a_twin_are_off_as_far_as_asked(played: Performance) -> None:
    plain, off, again = (played.recording(1, 1, gain=gain)["flow1_V"][1] for gain in (0.0, 0.2, 0.2))
    np.testing.assert_array_equal(off, again)
    flow = plain - plain[:20].mean()
    ratio = (off - plain) @ flow / (flow @ flow)
    assert 1e-3 < abs(ratio) < 0.2
    # All of the change is off alike, and the zero is not.
    np.testing.assert_allclose(off - plain, ratio * flow, atol=0.05 * np.abs(off - plain).max() + 2e-3)


def test_boards_are_those_that_see_contacts_and_the_rest(played: Performance) -> None:
    assert played.apart == (("x_mm", "y_mm", "force_N"), ("flow0_V", "flow1_V"))
    beam = virtual_robot(settings_of(BEAM), MakingErrors(nodes=0))
    with pytest.raises(ConfigError, match="two boards"):
        _ = Performance(beam, played.places, played.frames).apart


def test_commands_are_told_as_commanded() -> None:
    beam = virtual_robot(settings_of(BEAM), MakingErrors(nodes=0))
    drives = beam.made.addresses.drives
    drive, answer = np.zeros((2, 2)), np.zeros((2, 2))
    drive[1, drives["bladder"]], drive[1, drives["palm"]], answer[1, drives["palm"]] = 5e3, 4.0, 2e-3
    values = {"drive": drive, "answer": answer}
    played = Performance(
        beam, np.zeros((1, 1, 3)), Frames(TIME[:2], np.zeros(2, int), np.zeros(2, int), values)
    )
    commands = played.commands
    np.testing.assert_allclose(commands["winch_mm"], [0, 2])
    np.testing.assert_allclose(commands["supply_kPa"], [0, 5])


def test_performances_follow_each_other(played: Performance) -> None:
    both = in_turn([played, played])
    assert len(both.frames.time_s) == 2 * N and both.frames.episode.max() == 3 and len(both.places) == 4
    np.testing.assert_allclose(np.diff(both.frames.time_s), 0.01, rtol=1e-6)
