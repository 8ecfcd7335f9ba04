"""What recordings hold of presses of known place and force: what was done, and what the sensors said."""

import re
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from itertools import islice

import numpy as np
from jaxtyping import Int

from softfuse.calibration.presses import Applied, Presses
from softfuse.cli.device_calibration import AbstractCalibration, Felt
from softfuse.cli.recorded import sensor_frames
from softfuse.cli.terminal import tracked
from softfuse.errors import RecordingError, SoftfuseError
from softfuse.estimation.compiled_senses import CompiledSenses
from softfuse.hardware.recording import Recording
from softfuse.sensing.senses import Sensed


def chosen_frames(
    known: AbstractCalibration, recording: Recording, presses: str | None = None
) -> Int[np.ndarray, " s"]:
    """The frames (s,) at which a recording knows what presses, all or those of presses in a list such as
    "0-4,7".

    Raises RecordingError when there are none, SoftfuseError for another list.
    """
    at = known.frames(recording)
    if not at.size:
        raise RecordingError(
            f"the recording {recording.path} has no samples with known force: calibration needs the columns "
            f"{known.columns}"
        )
    if presses is None:
        return at
    wanted = parse_presses(presses)
    at = at[np.isin(recording.matrix(["press"])[at, 0], list(wanted))]
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


def felt_presses(
    known: AbstractCalibration,
    recordings: Sequence[Recording],
    chosen: Sequence[Int[np.ndarray, " s"]],
    *,
    quiet: bool,
) -> Felt:
    """The samples at frames (s,) of all recordings; the presses of different ones are different.

    Raises ConfigError for a device without sensors, RecordingError for one that lacks their columns.
    """
    contacts = max(known.contacts(recording) for recording in recordings)
    parts, called = list[Presses](), dict[int, str]()
    samples, read = list[Sensed](), list[tuple[Recording, tuple[Sensed, ...]]]()
    with ThreadPoolExecutor(1) as aside:
        senses = CompiledSenses(known.senses(), aside)
        for recording, at in zip(recordings, chosen, strict=True):
            last = int(at.max()) + 1
            frames = islice(sensor_frames(known.settings, recording), last)
            senses.reset()
            sensed = tuple(
                senses.update(frame.time_s, frame.readings).sensed
                for frame in tracked(frames, "sensing", total=last, quiet=quiet)
            )
            read.append((recording, sensed))
            found = [sensed[i] for i in at]
            samples += found
            part = known.presses(recording, at, found, contacts)
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
    readings, sigmas = ([getattr(part, name) for part in parts] for name in ("reading", "sigma"))
    presses = Presses(Applied(**whole), np.concatenate(readings), np.concatenate(sigmas))
    at = {press: known.at(presses.applied, press) for press in called}
    return Felt(presses, tuple(samples), called, at, tuple(read))
