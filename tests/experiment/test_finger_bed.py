"""The virtual finger: motion, sensors and recording on a made-up trajectory; one push that is computed."""

import dataclasses
import re
from dataclasses import replace
from pathlib import Path

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from softfuse.errors import ConfigError, MeshError, RecordingError
from softfuse.experiment.finger_bed import (
    CABLE_ALONE,
    TABLE_III,
    TWO_CONTACTS,
    BedSettings,
    recording_columns,
    write_finger_recording,
)
from softfuse.experiment.finger_electronics import Electronics, nearness, readings
from softfuse.experiment.finger_motion import Motion, Timing, motion
from softfuse.experiment.finger_pushes import (
    FingerSolver,
    Pose,
    Push,
    Steps,
    cable_levels,
    depth_levels,
    equilibria,
    passed_through,
)
from softfuse.experiment.recording_file import write_recording
from softfuse.experiment.virtual_finger import (
    FingerErrors,
    FingerSettings,
    rigid_tip,
    set_against,
    virtual_finger,
)
from softfuse.hardware.recording import read_recording
from softfuse.mechanics.load import Loads
from softfuse.mechanics.solution import State
from softfuse.mechanics.sparse import SparseLU
from softfuse.mesh.finger import FingerGeometry

RADIUS, HALF = 5e-3, 6e-3
PUSH = Push(contacts=((0, "left"),), cable=2e-3, depths=(1e-3, 2e-3))
TIMING = Timing(rate_Hz=100.0, cable_m_s=2e-3, tip_m_s=10e-3, rest_s=20.0, settle_s=1.0, hold_s=1.0)
SHORT = FingerSettings(
    drawing=FingerGeometry(
        size=(0.05, 0.02, 0.02),
        neck_x=(0.025,),
        neck_length=0.012,
        neck_height=0.015,
        cavity_size=(0.008, 0.006, 0.01),
        cavity_centres=((0.025, 0.005, 0.0125), (0.025, -0.005, 0.0125)),
    ),
    wall_size=1.0,
    base_size=0.03,
    growth=0.0,
    guides=((0.005, 0.0, 0.003), (0.015, 0.0, 0.003), (0.035, 0.0, 0.003), (0.045, 0.0, 0.003)),
    segment_x=(0.010, 0.040),
    points=((0.047, 0.0, 0.01), (0.025, 0.0, 0.0125)),
)
"""One neck, on the coarsest mesh."""


def pose(cable: float, depth: float) -> Pose:
    """A pose of a made-up finger with one electrode at the left face, that gives way as it likes."""
    square = np.array([[0.04 + a, 0.01, 0.01 + b] for a in (-6e-3, 0, 6e-3) for b in (-6e-3, 0, 6e-3)])
    pressed = max(depth, 0.0)
    return Pose(
        cable=np.array(cable),
        depth=np.array(depth),
        points=np.array([[0.047, -pressed, 0.01 - cable]]),
        electrodes=np.stack([square - [0, pressed, 0], square * [1, -1, 1] - [0, pressed, 0]]),
        gauge=np.array([-2e5 * pressed, 1e5 * pressed]),
        tension=np.array(100 * cable),
        force=np.array([50 * pressed, 0.0]),
        contact=np.array([[0.04, 0.01 - pressed, 0.01], [0, 0, 0]]),
        tip=np.array([[0.04, 0.01 - depth + RADIUS, 0.01], [0, 0, 0]]),
        axis=np.array([[0.0, 0, 1], [0, 0, 0]]),
    )


def poses() -> list[Pose]:
    """What a solver would give for PUSH: rest, cable, first contact, two depths."""
    return [pose(0, -0.03), pose(2e-3, -0.03), pose(2e-3, 0), pose(2e-3, 1e-3), pose(2e-3, 2e-3)]


@pytest.fixture(scope="module")
def moved() -> Motion:
    return motion([(PUSH, poses()), (replace(PUSH, contacts=((1, "left"),)), poses())], TIMING)


def test_a_push_takes_its_time(moved: Motion) -> None:
    one = 20.0 + 1.0 + 1.0 + 3.0 + 2 * (0.1 + 1.0) + 0.2 + 3.0 + 1.0
    assert moved.time[-1] == pytest.approx(2 * one + 20.0, abs=0.011)
    np.testing.assert_allclose(np.diff(moved.time), 0.01, rtol=1e-9)
    assert np.flatnonzero(np.diff(moved.press)).tolist() == [int(round(100 * one)) - 1]
    at_rest = moved.poses.depth == -0.03
    assert (moved.poses.cable[at_rest] == 0).sum() >= 3 * 2000
    speed = np.abs(np.diff(moved.poses.depth)) / 0.01
    assert speed.max() == pytest.approx(TIMING.tip_m_s, rel=1e-3)


def test_samples_lie_in_the_middle_of_the_holds(moved: Motion) -> None:
    frames = np.flatnonzero(moved.sample)
    assert moved.sample[frames].tolist() == [1, 2, 1, 2]
    np.testing.assert_allclose(moved.poses.depth[frames], [1e-3, 2e-3, 1e-3, 2e-3], rtol=1e-9)
    np.testing.assert_allclose(moved.poses.force[frames, 0], [0.05, 0.1, 0.05, 0.1], rtol=1e-9)
    for frame in frames:
        held = moved.poses.depth[frame - 49 : frame + 50]
        np.testing.assert_allclose(held, moved.poses.depth[frame], rtol=1e-6)


def test_a_push_without_tips_is_sampled_where_the_cable_is_held() -> None:
    push = Push(cable=2e-3)
    one = motion([(push, [pose(0, -0.03), pose(2e-3, -0.03)])], TIMING)
    assert one.poses.cable[one.sample == 1] == pytest.approx([2e-3])
    assert (one.electrode == -1).all()


def test_the_electrode_that_a_tip_faces_is_that_of_the_push(moved: Motion) -> None:
    np.testing.assert_array_equal(moved.electrode[:, 0], np.where(moved.press == 0, 1, 4))
    assert (moved.electrode[:, 1] == -1).all()


def test_electrodes_rise_towards_contact_and_saturate(moved: Motion) -> None:
    reach = Electronics().reach_m
    touched, other = nearness(moved.poses, RADIUS, HALF, reach).T
    depth = moved.poses.depth
    assert touched[depth == -0.03].max() < 1e-3
    assert (np.diff(touched[np.argsort(depth)]) >= -1e-9).all()
    # The tip lies on the electrode's middle line; the lines 6 mm aside are a little away from it.
    over = np.exp(-np.array([0.0, *[np.hypot(RADIUS, 6e-3) - RADIUS] * 2]) / reach).mean()
    np.testing.assert_allclose(touched[depth >= 0], over, rtol=1e-9)
    near = np.isclose(depth, -3e-3, atol=1e-6)
    assert near.any()
    assert ((0.3 * over < touched[near]) & (touched[near] < 0.6 * over)).all()
    assert other.max() < 0.02


def test_pressures_are_read_by_a_twelve_bit_converter(moved: Motion) -> None:
    perfect = Electronics(zero_bound_V=0.0, gain_sigma=0.0, drift_sigma_Pa_s=0.0)
    volts = readings(perfect, moved.time, moved.poses, RADIUS, HALF).pressure_V
    step = 5.0 / 4096
    np.testing.assert_allclose(volts / step, np.rint(volts / step), atol=1e-9)
    left = volts - 5.0 * (0.009e-3 * (101325.0 + moved.poses.gauge) - 0.095)
    assert abs(left.mean()) < 1e-4
    # Noise and a rounding error, which is uniform within one step.
    assert left.std() == pytest.approx(np.hypot(1e-3, step / np.sqrt(12)), rel=0.05)


def test_parts_are_off_by_less_than_the_data_sheet_allows_but_off(moved: Motion) -> None:
    volts = readings(Electronics(), moved.time, moved.poses, RADIUS, HALF).pressure_V[:1000].mean(axis=0)
    error_Pa = (volts / 5.0 + 0.095) / 0.009e-3 - 101325.0
    assert (np.abs(error_Pa) < 2 * 2.5e3).all()
    assert (np.abs(error_Pa) > 50.0).all()


def test_a_pressure_beyond_the_converter_is_clipped(moved: Motion) -> None:
    extreme = dataclasses.replace(moved.poses, gauge=np.where(moved.poses.gauge > 0, 1e5, -1e5))
    volts = readings(Electronics(), moved.time, extreme, RADIUS, HALF).pressure_V
    assert volts.min() == 0.0
    assert volts.max() == pytest.approx(5.0 * 4095 / 4096)


def test_counts_and_cable_carry_their_noise(moved: Motion) -> None:
    read = readings(Electronics(), moved.time, moved.poses, RADIUS, HALF)
    assert read.electrode.dtype.kind == "i"
    rest = read.electrode[:1500]
    np.testing.assert_allclose(rest.std(axis=0), 8.0, rtol=0.1)
    assert (np.abs(rest.mean(axis=0) - 16000) < 3000).all()
    held = moved.sample > 0
    assert (read.electrode[held, 0] - rest[:, 0].mean() > 1500).all()
    error = read.cable - moved.poses.cable
    assert error.std() == pytest.approx(0.05e-3, rel=0.05)
    assert abs(error.mean()) < 5e-6


def test_the_seed_decides(moved: Motion) -> None:
    first, again, other = (
        readings(Electronics(seed=seed), moved.time, moved.poses, RADIUS, HALF) for seed in (5, 5, 6)
    )
    np.testing.assert_array_equal(first.pressure_V, again.pressure_V)
    np.testing.assert_array_equal(first.electrode, again.electrode)
    np.testing.assert_array_equal(first.cable, again.cable)
    assert (first.pressure_V.mean(axis=0) != other.pressure_V.mean(axis=0)).all()


def test_the_recording_is_read_back(moved: Motion, tmp_path: Path) -> None:
    read = readings(Electronics(), moved.time, moved.poses, RADIUS, HALF)
    write_recording(tmp_path / "a.csv.gz", recording_columns(moved, read))
    names = [
        *("pressure0_V", "pressure1_V", "electrode0", "electrode1", "cable0_mm", "press", "sample"),
        *("true_p0_x_mm", "true_p0_y_mm", "true_p0_z_mm", "true_force0_N", "true_force1_N"),
        *("true_contact0_x_mm", "true_contact0_y_mm", "true_contact0_z_mm", "true_contact0_electrode"),
        *("true_contact1_x_mm", "true_contact1_y_mm", "true_contact1_z_mm", "true_contact1_electrode"),
        *("true_depth_mm", "true_cable_mm", "true_cable_N", "true_pressure0_Pa", "true_pressure1_Pa"),
    ]
    found = read_recording(tmp_path / "a.csv.gz", names)
    assert list(found.columns) == ["time_s", *names]
    assert not found.malformed.any()
    assert not found.disordered.any()
    np.testing.assert_allclose(found.columns["pressure0_V"], read.pressure_V[:, 0], atol=6e-6)
    np.testing.assert_array_equal(found.columns["electrode1"], read.electrode[:, 1])
    np.testing.assert_allclose(found.columns["cable0_mm"], 1e3 * read.cable, atol=6e-4)
    np.testing.assert_allclose(found.columns["true_p0_y_mm"], 1e3 * moved.poses.points[:, 0, 1], atol=6e-5)
    np.testing.assert_allclose(found.columns["true_force0_N"], moved.poses.force[:, 0], atol=6e-6)
    np.testing.assert_array_equal(found.columns["sample"], moved.sample)


def test_columns_say_no_negative_zero(moved: Motion, tmp_path: Path) -> None:
    read = readings(Electronics(), moved.time, moved.poses, RADIUS, HALF)
    write_recording(tmp_path / "a.csv", recording_columns(moved, read))
    assert not re.search(r"(^|,)-0(\.0*)?(,|$)", (tmp_path / "a.csv").read_text(), re.MULTILINE)
    assert set(recording_columns(moved, read)) == set(
        (tmp_path / "a.csv").read_text().split("\n", 1)[0].split(",")
    )


def test_a_folder_that_is_missing_is_told(moved: Motion, tmp_path: Path) -> None:
    read = readings(Electronics(), moved.time, moved.poses, RADIUS, HALF)
    with pytest.raises(RecordingError, match="cannot write the recording"):
        write_recording(tmp_path / "none" / "a.csv", recording_columns(moved, read))


def test_levels_hold_what_is_sampled_and_step_no_further() -> None:
    push = Push(((3, "left"),), 10e-3, (5e-3, 10e-3, 11e-3))
    np.testing.assert_allclose(cable_levels(push, Steps()), 1e-3 * np.array([0, 2.5, 5, 7.5, 10]))
    np.testing.assert_allclose(depth_levels(push, Steps()), 1e-3 * np.array([0, 2.5, 5, 7.5, 10, 11]))
    assert set(push.depths) <= set(depth_levels(push, Steps()).tolist())
    assert equilibria(push, Steps()) == 9
    assert equilibria(Push(cable=10e-3), Steps(cable=3e-3)) == 4


def test_the_scenarios_are_those_of_the_paper_and_its_neighbours() -> None:
    assert {(push.contacts[0], push.cable) for push in TABLE_III} == {
        ((segment, "left"), cable) for segment in (3, 2) for cable in (0.0, 0.01)
    }
    assert all(push.depths == (5e-3, 10e-3, 15e-3, 20e-3) for push in TABLE_III)
    assert all(len({segment for segment, _ in push.contacts}) == 2 for push in TWO_CONTACTS)
    assert all(not push.contacts and push.cable > 0 for push in CABLE_ALONE)


@pytest.fixture(scope="module")
def finger():
    return virtual_finger(SHORT)


def test_the_finger_is_off_its_drawing_within_bounds(finger) -> None:
    rest = np.asarray(finger.gas.rest)
    low, high = (7.8e-3 * 5.8e-3 * 9.8e-3, 8.2e-3 * 6.2e-3 * 10.2e-3)
    assert ((low < rest) & (rest < high)).all()
    assert (np.abs(rest - 480e-9) > 1e-9).all()
    drawn = virtual_finger(replace(SHORT, errors=FingerErrors(0.0, 0.0, 0.0, 0.0)))
    np.testing.assert_allclose(np.asarray(drawn.gas.rest), 480e-9, rtol=1e-9)
    guides = np.asarray(finger.cable.ports.points.location - drawn.cable.ports.points.location)
    assert (np.abs(guides) <= 0.3e-3).all()
    assert np.abs(guides).max() > 0.1e-3
    other = virtual_finger(replace(SHORT, errors=FingerErrors(seed=9)))
    assert (np.asarray(other.gas.rest) != rest).all()


def test_the_finger_at_rest_is_where_it_is_drawn(finger) -> None:
    rest = np.asarray(finger.body.rest)
    np.testing.assert_allclose(finger.points.at(rest), SHORT.points, atol=1e-12)
    electrodes = finger.electrodes.at(rest).reshape(6, 9, 3)
    faces = [(axis, 0.01 * side) for axis, side in ((2, 0), (1, 1), (1, -1))] * 2
    for (axis, value), square in zip(faces, electrodes, strict=True):
        np.testing.assert_allclose(square[:, axis], value, atol=1e-12)
    np.testing.assert_allclose(electrodes.mean(axis=1)[:, 0], np.repeat(SHORT.segment_x, 3), atol=1e-12)


def test_one_push_is_computed_and_recorded(tmp_path: Path) -> None:
    push = Push(((1, "left"),), 0.0, (1e-3,))
    settings = BedSettings(pushes=(push,), finger=SHORT, timing=TIMING)
    count: list[int] = []
    # Compiles faster than the multifrontal solver, which a finger of this size does not need.
    write_finger_recording(tmp_path / "a.csv", settings, plan=SparseLU.plan, solved=lambda: count.append(1))
    assert len(count) == settings.equilibria == 1
    recording = read_recording(tmp_path / "a.csv", ["sample"])
    at = int(np.flatnonzero(recording.columns["sample"])[0])
    held = {name: float(values[at]) for name, values in recording.columns.items()}
    assert held["true_depth_mm"] == 1.0
    assert 0.05 < held["true_force0_N"] < 5.0
    assert held["true_force1_N"] == 0.0
    # The cable keeps its length, so that a bent finger pulls on it.
    assert held["true_cable_N"] > 0.0
    # The tip pushes towards -y: the end follows, the left cavity is stretched, the right one squeezed.
    assert -2.0 < held["true_p0_y_mm"] < -0.5
    assert held["true_pressure0_Pa"] < 0 < held["true_pressure1_Pa"]
    assert abs(held["true_contact0_x_mm"] - 40.0) < 7.0
    assert held["true_contact0_electrode"] == 4
    assert held["electrode4"] - recording.columns["electrode4"][:1000].mean() > 1000
    rise = held["pressure1_V"] - recording.columns["pressure1_V"][:1000].mean()
    assert rise == pytest.approx(5 * 0.009e-3 * held["true_pressure1_Pa"], abs=6e-3)


def test_a_tip_is_set_against_the_side_as_it_lies(finger) -> None:
    tip = rigid_tip(finger, 1, "left")
    rest = np.asarray(tip.ports.values(finger.body, jnp.zeros(finger.body.n))).reshape(-1, 3)
    grid = (*SHORT.patch_points, 3)
    same, first = set_against(tip, rest.reshape(grid))
    np.testing.assert_allclose(same.centre, [0.04, 0.01 + RADIUS, 0.01], atol=1e-12)
    np.testing.assert_allclose(same.direction, [0.0, -1.0, 0.0], atol=1e-12)
    assert first == pytest.approx(0.0, abs=1e-12)
    turn = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    turned, first = set_against(tip, (rest @ turn.T + 0.01).reshape(grid))
    np.testing.assert_allclose(turned.centre, turn @ np.asarray(same.centre) + 0.01, atol=1e-12)
    np.testing.assert_allclose(turned.direction, turn @ [0.0, -1.0, 0.0], atol=1e-12)
    assert abs(np.asarray(turned.axis) @ turn @ [0.0, 0.0, 1.0]) == pytest.approx(1.0)
    # A bump on the middle line is met before the rest.
    bumpy = rest.copy()
    bumpy[19, 1] += 1e-3
    _, first = set_against(tip, bumpy.reshape(grid))
    assert first == pytest.approx(-1e-3, rel=0.1)


def test_a_tip_that_left_the_finger_behind_is_seen(finger) -> None:
    tip = rigid_tip(finger, 1, "left")
    rest = State.rest(finger.body, Loads((tip,)))

    def moved_to(advance: float) -> State:
        return eqx.tree_at(lambda s: s.drive, rest, jnp.array([advance]))

    # With the finger where it rests the tip is before it, touches it, and is beyond its skin.
    assert not passed_through(finger, (tip,), moved_to(-0.03))
    assert not passed_through(finger, (tip,), moved_to(0.0))
    assert passed_through(finger, (tip,), moved_to(2.5 * RADIUS))


@pytest.mark.parametrize(
    ("push", "words"),
    [
        (Push(((0, "left"),)), "0 depths"),
        (Push(depths=(1e-3,)), "1 depths"),
        (Push(((0, "left"), (0, "left")), 0.0, (1e-3,)), "two tips at one place"),
        (Push(((0, "left"), (0, "palm"), (0, "right")), 0.0, (1e-3,)), "at most 2"),
        (Push(((0, "left"),), 0.0, (2e-3, 1e-3)), "increase"),
        (Push(((0, "left"),), -1e-3, (1e-3,)), "must not be negative"),
        (Push(((2, "left"),), 0.0, (1e-3,)), "segment 2 cannot be pushed"),
    ],
)
def test_a_push_that_is_none_is_told(finger, push: Push, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        FingerSolver(finger, Steps()).poses(push)


def test_a_drawing_that_cannot_be_made_is_told() -> None:
    wide = replace(SHORT, drawing=replace(SHORT.drawing, cavity_size=(8e-3, 12e-3, 10e-3)))
    with pytest.raises(MeshError):
        virtual_finger(wide)
    with pytest.raises(ConfigError, match="silicone"):
        virtual_finger(replace(SHORT, silicone="porridge"))
