"""What recordings hold of presses of known place and force: what was done to a robot, and what its sensors
said.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from softfuse.calibration.of_robot import Fitted
from softfuse.calibration.presses import Applied, Presses
from softfuse.errors import RecordingError, SoftfuseError
from softfuse.estimation.compiled_suite import CompiledSuite
from softfuse.estimation.tracked import Frame
from softfuse.experiment.accuracy import NOWHERE
from softfuse.functional.chart import facing
from softfuse.hardware.recording import Recording, read_recording
from softfuse.report.columns import Columns
from softfuse.report.truth import Truth
from softfuse.robot.robot import Robot, require_sensors
from softfuse.robot.settings import RobotSettings
from softfuse.sensors.suite import Observation, SensorSuite

_AT_ONCE = 1 << 14
"""Frames that are made from the columns side by side."""


def read_sensors(settings: RobotSettings, path: Path) -> Recording:
    """A recording of a robot's sensors.

    Raises ConfigError for a robot without sensors, RecordingError as `read_recording` does.
    """
    require_sensors(settings)
    return read_recording(path, list(settings.channels), settings.recording)


def sensor_frames(settings: RobotSettings, recording: Recording) -> Iterator[Frame]:
    """The recording's frames with the readings in the order of the robot's channels, one after the other."""
    n = len(recording.time_s)
    for start in range(0, n, _AT_ONCE):
        part = recording.rows(np.arange(start, min(start + _AT_ONCE, n)))
        raw = part.matrix(settings.channels)
        for at, readings in zip(part.time_s, raw, strict=True):
            yield Frame(float(at), readings)


@dataclass(frozen=True, eq=False)
class Part:
    """The frames of a recording that are estimated, flagged among all of its n frames, and alone."""

    estimated: Bool[np.ndarray, " n"]
    recording: Recording

    @classmethod
    def of(cls, whole: Recording, every: int) -> "Part":
        """Every so many frames, and the samples with truth."""
        estimated = np.arange(len(whole.time_s)) % every == 0
        if "sample" in whole.columns:
            estimated |= whole.columns["sample"] > 0
        return cls(estimated, whole.rows(np.flatnonzero(estimated)))


@dataclass(frozen=True, eq=False)
class Felt:
    """Presses, and what was observed at each of their samples (s,); of each press what people call it and
    where it is; and the recordings (r,) with what was observed in all their frames up to the last sample.
    """

    presses: Presses
    observed: tuple[Observation, ...]
    called: dict[int, str]
    at: dict[int, str]
    recordings: tuple[tuple[Recording, tuple[Observation, ...]], ...]


@dataclass(frozen=True, eq=False)
class Known:
    """What a recording knows of c contacts in n frames: forces (n, c) [N], places (n, c, 3, 3), which frames
    (s,) are samples at which all is known, and the number of the press (n,).
    """

    force_N: Float[np.ndarray, "n c"]
    place: Float[np.ndarray, "n c 3 3"]
    samples: Int[np.ndarray, " s"]
    press: Int[np.ndarray, " n"]

    @classmethod
    def of(cls, robot: Robot, recording: Recording) -> "Known":
        """What a recording knows of presses on a robot.

        Raises RecordingError when it knows of none.
        """
        truth = Truth.of(recording, Columns(robot))
        n = len(recording.time_s)
        if truth.place.shape[1]:
            force, place, known = _on_places(robot, truth)
        else:
            force, place, known = _anywhere(robot, truth)
        samples = np.flatnonzero(known & (truth.level > 0))
        if not samples.size:
            raise RecordingError(
                f"the recording {recording.path} has no samples with known force: calibration needs the "
                "columns sample (1, 2, ... where all is held), and true_x_mm, true_y_mm (and true_z_mm) with "
                "true_force_N, or true_force0_N and true_contact0_electrode of each contact"
            )
        has = "press" in recording.columns and np.isfinite(recording.columns["press"])
        press = np.where(has, truth.press, -1 - np.arange(n)).astype(int)
        return cls(force, place, samples, press)


def _on_places(robot: Robot, truth: Truth) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, " n"]]:
    """Of contacts on places that have a name."""
    force, place = truth.contact_N, truth.place
    table = np.array(list(robot.settings.places.values()))
    there = (place >= 0) & (place < len(table))
    known = np.isfinite(force) & (there | (force <= 0))
    # Of further contacts an empty row says that there are none.
    known[:, 1:] |= ~np.isfinite(force[:, 1:]) & (place[:, 1:] == NOWHERE)
    # What a force sensor reads below 0 is its noise.
    return (
        np.maximum(np.nan_to_num(force), 0.0),
        table[np.where(there, place, 0)],
        np.asarray(known.all(axis=1)),
    )


def _anywhere(robot: Robot, truth: Truth) -> tuple[np.ndarray, np.ndarray, Bool[np.ndarray, " n"]]:
    """Of one contact at a point of the surface."""
    force = truth.get("force_N")
    point = 1e-3 * np.stack([truth.get(f"{axis}_mm") for axis in "xyz"], axis=1)
    contact, workspace = robot.settings.contacts[0], robot.workspaces[0]
    if contact.direction is not None:
        # Seen along its direction, a point is where it is whatever its height.
        point[:, 2] = np.where(np.isfinite(point[:, 2]), point[:, 2], 0.0)
    known = np.isfinite(force) & (force > 0) & np.isfinite(point).all(axis=1)
    place = facing(np.nan_to_num(point), contact.direction or (0.0, 0.0, -1.0))
    if contact.direction is None and workspace is not None and known.any():
        place[known] = workspace.landed(place[known])
    return np.nan_to_num(force)[:, None], place[:, None], known


def chosen(known: Known, recording: Recording, presses: str | None) -> Int[np.ndarray, " s"]:
    """The samples (s,) of a recording, all or those of presses in a list such as "0-4,7".

    Raises RecordingError when there are none, SoftfuseError for another list.
    """
    if presses is None:
        return known.samples
    at = known.samples[np.isin(known.press[known.samples], list(parse_presses(presses)))]
    if not at.size:
        raise RecordingError(f"the recording {recording.path} has no samples in the presses {presses}")
    return at


def parse_presses(text: str) -> set[int]:
    """The numbers in a list such as "0-4,7"; raises SoftfuseError when it is something else."""
    wanted: set[int] = set()
    for part in text.split(","):
        ends = re.fullmatch(r"\s*(\d+)(?:-(\d+))?\s*", part)
        if ends is None:
            raise SoftfuseError(f'--presses "{text}" is no list of numbers: give one such as 0-4 or 0,2,5-7')
        first = int(ends[1])
        wanted |= set(range(first, int(ends[2] or first) + 1))
    return wanted


def of_noise_alone(settings: RobotSettings) -> RobotSettings:
    """The settings of sensors whose standard deviations are those of noise and zeros alone, where they hold a
    model's errors: these and gains that are off are the same in all presses, which is what a fit finds.
    """
    sensors = tuple(
        sensor.model_copy(update={"model_error": 0.0, "gain_sigma": 0.0})
        if sensor.errs_with_model
        else sensor
        for sensor in settings.sensors
    )
    return settings.model_copy(update={"sensors": sensors})


def felt_presses(
    fitted: Fitted,
    recordings: Sequence[Recording],
    presses: str | None,
    *,
    seen: Callable[[], None] = lambda: None,
) -> Felt:
    """The samples of all recordings, all or those of presses in a list; the presses of different recordings
    are different. `seen` is called after each frame.

    Raises RecordingError as `Known.of` and `chosen` do.
    """
    robot = fitted.robot
    known = [Known.of(robot, recording) for recording in recordings]
    contacts = max(each.force_N.shape[1] for each in known)
    parts, called = list[Presses](), dict[int, str]()
    samples, read = list[Observation](), list[tuple[Recording, tuple[Observation, ...]]]()
    suite = SensorSuite.of(of_noise_alone(robot.settings).sensors, robot.parts)
    with ThreadPoolExecutor(1) as aside:
        compiled = CompiledSuite(suite, aside)
        for each, recording in zip(known, recordings, strict=True):
            at = chosen(each, recording, presses)
            raw = recording.matrix(list(suite.channels))
            compiled.reset()
            observed = []
            end = recording.time_s[at.max()] + max(_averaged_s(robot), default=0.0)
            seen_frames = int(np.flatnonzero(recording.time_s <= end)[-1]) + 1
            for time_s, row in zip(recording.time_s[:seen_frames], raw, strict=False):
                observed.append(compiled.update(float(time_s), row).observation)
                seen()
            read.append((recording, tuple(observed)))
            samples += [observed[i] for i in at]
            part = _presses(fitted, recording, each, at, observed, contacts)
            names, number = np.unique(part.applied.press, return_inverse=True)
            where = f" of {recording.path.name}" if len(recordings) > 1 else ""
            parts.append(replace(part, applied=replace(part.applied, press=number + len(called))))
            called |= {
                k + len(called): f"{name if name >= 0 else 'without number'}{where}"
                for k, name in enumerate(names)
            }
    whole = {
        each.name: np.concatenate([getattr(part.applied, each.name) for part in parts])
        for each in fields(Applied)
    }
    readings, sigmas = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("reading", "sigma")
    )
    together = Presses(Applied(**whole), readings, sigmas, fitted.kind)
    at = {press: press_at(fitted, together.applied, press) for press in called}
    return Felt(together, tuple(samples), called, at, tuple(read))


def _presses(
    fitted: Fitted,
    recording: Recording,
    known: Known,
    at: Int[np.ndarray, " s"],
    observed: Sequence[Observation],
    contacts: int,
) -> Presses:
    """Samples at frames (s,) of a recording in whose first frames so much was observed, under so many
    contacts, some without force.
    """
    reading, sigma, valid = (
        np.array([getattr(each, name) for each in observed]) for name in ("reading", "sigma", "valid")
    )
    reading = without_lag(recording.time_s[: len(reading)], reading, valid, _averaged_s(fitted.robot), at)
    sigma, valid = sigma[at], valid[at]
    more = contacts - known.force_N.shape[1]
    force = np.pad(known.force_N[at], ((0, 0), (0, more)))
    place = known.place[at]
    place = np.concatenate([place, np.repeat(place[:, :1], more, axis=1)], axis=1)
    prescribed, usable = _prescribed(fitted, recording, at, reading, valid)
    own = fitted.readings
    told = valid[:, own] & usable[:, None]
    if fitted.robot.suite.contact_sensors:
        # What nothing is felt to touch has read nothing.
        touched = np.array([observed[i].touching.any() for i in at])
        told &= (touched | ~(force > 0).any(axis=1))[:, None]
    return Presses(
        Applied(place, force, prescribed, known.press[at]),
        reading[:, own],
        np.where(told, sigma[:, own], np.inf),
        fitted.kind,
    )


def _averaged_s(robot: Robot) -> Float[np.ndarray, " k"]:
    """Time constants (k,) [s] of the means that a robot's readings are."""
    averaged, own = np.zeros(robot.model.n_readings), robot.addresses.readings
    for sensor in robot.settings.sensors:
        if sensor.name in own:
            averaged[own[sensor.name]] = sensor.averaged_s
    return averaged


def without_lag(
    time_s: Float[np.ndarray, " n"],
    reading: Float[np.ndarray, "n k"],
    valid: Bool[np.ndarray, "n k"],
    averaged_s: Float[np.ndarray, " k"],
    at: Int[np.ndarray, " s"],
) -> Float[np.ndarray, "s k"]:
    """What sensors read around frames (s,) whose readings (n, k) at times (n,) s are exponential means with
    time constants τ (k,) s of what they read, y: half a second after a force has risen, one of 0.2 s may
    still miss 3 % of it, which a fit takes for another silicone.

    y = m + τ dm/dt of a mean m, here averaged from τ before to τ after a frame, which leaves as much noise as
    m has. It is m of a reading that is not valid all the while.
    """
    found = reading[at]
    for averaged in np.unique(averaged_s[averaged_s > 0]):
        for sample, frame in enumerate(at):
            near = np.flatnonzero(np.abs(time_s - time_s[frame]) <= averaged)
            own = np.flatnonzero((averaged_s == averaged) & valid[near].all(axis=0))
            time, mean = time_s[near], reading[near][:, own]
            if len(near) > 1 and (np.diff(time) > 0).all():
                whole = np.trapezoid(mean, time, axis=0) + averaged * (mean[-1] - mean[0])
                found[sample, own] = whole / (time[-1] - time[0])
    return found


def _prescribed(
    fitted: Fitted,
    recording: Recording,
    at: Int[np.ndarray, " s"],
    reading: Float[np.ndarray, "s k"],
    valid: Bool[np.ndarray, "s k"],
) -> tuple[Float[np.ndarray, "s a"], Bool[np.ndarray, " s"]]:
    """What the actuators are driven with in samples, and in which of them that is known (s,)."""
    low, _ = fitted.robot.ranges
    prescribed, known = np.tile(low, (len(at), 1)), np.ones(len(at), bool)
    for number in np.flatnonzero(fitted.told >= 0):
        prescribed[:, fitted.told[number]] = reading[:, number]
        # Where nobody knows what an actuator does, nothing is known of the shape.
        known &= valid[:, number]
    for command in fitted.robot.commands:
        given = recording.columns[command.channel][at] * command.factor
        prescribed[:, command.drive] = np.nan_to_num(given)
        known &= np.isfinite(given)
    return prescribed, known


def press_at(fitted: Fitted, applied: Applied, press: int) -> str:
    """Where a press is, as people read it: its places, and what its actuators do."""
    settings = fitted.robot.settings
    on = applied.press == press
    words = []
    for place, force in zip(applied.place[on].swapaxes(0, 1), applied.force_N[on].T, strict=True):
        if np.any(force > 0):
            words.append(place_name(settings, place[force > 0][0]))
    said = [", ".join(words) or "no contact"] if settings.places else words or ["no contact"]
    largest = applied.prescribed[on].max(axis=0) if applied.prescribed.shape[1] else np.zeros(0)
    for cable, shortened in zip(settings.cables, fitted.shortened, strict=True):
        value = largest[fitted.robot.addresses.drives[cable.name]]
        # Adding 0 takes the sign off a 0.
        said.append(
            f"{cable.name} {np.round(1e3 * value, 1) + 0.0:.1f} mm"
            if shortened
            else f"{cable.name} {value:.2f} N"
        )
    for chamber in settings.chambers:
        if chamber.gas == "driven":
            said.append(
                f"{chamber.name} {1e-3 * largest[fitted.robot.addresses.drives[chamber.name]]:.1f} kPa"
            )
    return "; ".join(said)


def place_name(settings: RobotSettings, place: Float[np.ndarray, "3 3"]) -> str:
    """The name of a place that has one, else its coordinates in mm."""
    named = settings.places
    for name, other in named.items():
        if np.allclose(other[0], place[0], atol=1e-6):
            return name
    flat = settings.contacts and settings.contacts[0].within is not None
    point = 1e3 * place[0][: 2 if flat else 3]
    return f"({', '.join(f'{x:.1f}' for x in point)}) mm"
