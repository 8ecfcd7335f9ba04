"""The truth that a recording may hold: columns `true_<column of an estimate>`, and which frames count.

A sample is a frame in which `sample` is positive, its number that of the level of force or depth; `press`
counts presses. Where a contact truly is: `true_x_mm`, `true_y_mm`, perhaps `true_z_mm`, and `true_force_N`;
of several `true_<contact><number>_x_mm` ... and `true_<contact><number>_place`, the name of a place such as
an electrode, or its number; points `true_<point>_x_mm` ..., cables `true_<cable>_mm` and `true_<cable>_N`,
chambers `true_<chamber>_Pa` and `true_<chamber>_mm3`; `true_depth_mm` of what presses. Contacts, cables and
chambers that are only numbered are understood as well: `true_force0_N`, `true_contact0_electrode`,
`true_cable_mm`, `true_cable0_N`, `true_pressure0_Pa`, `true_dV0_mm3`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from softfuse.errors import RecordingError
from softfuse.estimation.tracked import Tracked
from softfuse.experiment.accuracy import NOWHERE, Samples
from softfuse.hardware.recording import Recording
from softfuse.report.columns import Columns

_FAR_M = 20e-3
"""Further apart, one is missed and the other found where nothing presses."""


@dataclass(frozen=True, eq=False)
class Truth:
    """What is known of n frames.

    `columns`: true values (n,) of columns of an estimate, NaN where a field is empty; `level`, `press` (n,):
    see above, 0 where unknown; `contact_N` (n, t): forces of t contacts; `place` (n, p): numbers of the
    named places of those that have some, `NOWHERE` without one; `depth_mm` (n,), None where not known.
    """

    columns: Mapping[str, Float[np.ndarray, " n"]]
    level: Int[np.ndarray, " n"]
    press: Int[np.ndarray, " n"]
    contact_N: Float[np.ndarray, "n t"]
    place: Int[np.ndarray, "n p"]
    depth_mm: Float[np.ndarray, " n"] | None

    @classmethod
    def of(cls, recording: Recording, columns: Columns) -> "Truth":
        """What a recording says about a robot with such columns.

        Raises RecordingError when it holds some of the points' columns only, or a contact's force without its
        place where others have one.
        """
        given = _named(recording, columns)
        n = len(recording.time_s)
        missing = np.full(n, np.nan)
        force, place = _contacts(recording, columns, given)
        _check_points(recording, columns, given)
        depth = recording.columns.get("true_depth_mm")
        return cls(
            given,
            _whole(recording.columns.get("sample", missing), 0),
            _whole(recording.columns.get("press", missing), 0),
            force,
            place,
            depth,
        )

    def get(self, name: str) -> Float[np.ndarray, " n"]:
        """True values (n,) of a column, NaN where nothing is known."""
        return self.columns.get(name, np.full(len(self.level), np.nan))

    def matrix(self, names: Sequence[str]) -> Float[np.ndarray, "n m"] | None:
        """True values (n, m) of some columns; None where all of one are unknown."""
        if not names or not all(name in self.columns for name in names):
            return None
        return np.stack([self.columns[name] for name in names], axis=1)

    def samples(self, names: Sequence[str]) -> Int[np.ndarray, " s"]:
        """The frames (s,) that count and in which some columns are known."""
        known = self.matrix(names)
        if known is None:
            return np.zeros(0, int)
        return np.flatnonzero((self.level > 0) & np.isfinite(known).all(axis=1))

    @property
    def without_force(self) -> Bool[np.ndarray, " n"]:
        """Frames (n,) in which nothing is known to press; all of them are unknown without contacts."""
        if self.contact_N.shape[1]:
            return np.all(self.contact_N == 0, axis=1)
        return self.get("force_N") == 0

    @property
    def without_contact(self) -> Bool[np.ndarray, " n"]:
        """Those of them in which there is nothing that could, as far as that is known."""
        return self.without_force & np.all(self.place == NOWHERE, axis=1) & (self.place.shape[1] > 0)


def _named(recording: Recording, columns: Columns) -> dict[str, np.ndarray]:
    """True values by columns of an estimate."""
    wanted = {column.name for column in columns.columns if column.digits is not None}
    wanted |= {f"{name}_{unit}" for name in columns.chambers.values() for unit in ("mm3", "Pa")}
    found = {
        name: recording.columns[f"true_{name}"] for name in wanted if f"true_{name}" in recording.columns
    }
    for kind, names, units in (
        ("cable", columns.cables.values(), ("mm", "N")),
        ("pressure", columns.chambers.values(), ("Pa",)),
        ("dV", columns.chambers.values(), ("mm3",)),
    ):
        for k, name in enumerate(names):
            for unit in units:
                numbered = [f"true_{kind}{k}_{unit}", *([f"true_{kind}_{unit}"] if len(names) == 1 else [])]
                for column in numbered:
                    if column in recording.columns:
                        found.setdefault(f"{name}_{unit}", recording.columns[column])
    return found


def _contacts(
    recording: Recording, columns: Columns, given: dict[str, np.ndarray]
) -> tuple[Float[np.ndarray, "n t"], Int[np.ndarray, "n k"]]:
    """Forces and places of the contacts that truly are there, which are also put among what is given."""
    forces, places = list[np.ndarray](), list[np.ndarray]()
    for k, slot in enumerate(columns.slots):
        force = _first(recording, f"true_{slot}_force_N", f"true_force{k}_N")
        if force is None:
            continue
        given.setdefault(f"{slot}_force_N", recording.columns[force])
        for axis in "xyz":
            at = _first(recording, f"true_{slot}_{axis}_mm", f"true_contact{k}_{axis}_mm")
            if at is not None:
                given.setdefault(f"{slot}_{axis}_mm", recording.columns[at])
        forces.append(recording.columns[force])
        if columns.named[k]:
            place = _first(recording, f"true_{slot}_place", f"true_contact{k}_electrode")
            if place is None:
                raise RecordingError(
                    f"the recording {recording.path} lacks the column 'true_{slot}_place': where the force "
                    f"in {force!r} is"
                )
            places.append(_whole(recording.numbered(place, columns.places, unknown=NOWHERE), NOWHERE))
    n = len(recording.time_s)
    return (
        np.array(forces).reshape(-1, n).T,
        np.array(places, int).reshape(-1, n).T,
    )


def _first(recording: Recording, *names: str) -> str | None:
    """The first of some columns that there is."""
    return next((name for name in names if name in recording.columns or name in recording.labels), None)


def _check_points(recording: Recording, columns: Columns, given: Mapping[str, np.ndarray]) -> None:
    names = [f"{name}_{axis}_mm" for name in columns.points.values() for axis in "xyz"]
    missing = [name for name in names if name not in given]
    if missing and len(missing) < len(names):
        recording.matrix([f"true_{name}" for name in missing])


def _whole(values: np.ndarray, unknown: int) -> np.ndarray:
    return np.where(np.isfinite(values), values, unknown).astype(int)


@dataclass(frozen=True, eq=False)
class MatchedContacts:
    """The true contacts of the samples with those that were found nearest; `true` (s, t): where one presses;
    how many nothing was found of, `missed`, and how many were found elsewhere, `misplaced`.
    """

    samples: Samples
    true: Bool[np.ndarray, "s t"]
    missed: int
    misplaced: int


def matched_contacts(found: Sequence[Tracked], truth: Truth, slots: Sequence[str]) -> MatchedContacts | None:
    """Of contacts in slots with these names; None where the truth does not know each one's place.

    In each sample true and found contacts are assigned one to one so that the sum of their distances is
    least, where those that are too far apart count the same.
    """
    known = [slot for slot in slots if f"{slot}_x_mm" in truth.columns and f"{slot}_force_N" in truth.columns]
    if not known:
        return None
    axes = [axis for axis in "xyz" if all(f"{slot}_{axis}_mm" in truth.columns for slot in known)]
    places = np.stack([[1e-3 * truth.get(f"{s}_{a}_mm") for a in axes] for s in known]).transpose(2, 0, 1)
    forces = np.stack([truth.get(f"{slot}_force_N") for slot in known], axis=1)
    at = np.flatnonzero(truth.level > 0)
    pressed = (forces[at] > 0) & np.isfinite(places[at]).all(axis=2)
    if not pressed.any():
        return None
    used = ["xyz".index(axis) for axis in axes]
    rows, missed, misplaced = [], 0, 0
    for i, true in zip(at.tolist(), pressed, strict=True):
        now = found[i]
        there = np.flatnonzero(now.touching & np.isfinite(now.location_m).all(axis=1))
        which = _assigned(places[i, true], now.location_m[there][:, used])
        misplaced += len(there) - sum(k is not None for k in which)
        missed += sum(k is None for k in which)
        for t, k in zip(np.flatnonzero(true), which, strict=True):
            c = None if k is None else int(there[k])
            rows.append((truth.level[i], *_row(now, c, used), places[i, t], forces[i, t]))
    level, location, sigma, force, force_sigma, true_at, true_N = (
        np.array(each) for each in zip(*rows, strict=True)
    )
    samples = Samples(level, location, force, true_at, true_N, sigma, force_sigma)
    return MatchedContacts(samples, pressed, missed, misplaced)


def _assigned(true: Float[np.ndarray, "t d"], found: Float[np.ndarray, "c d"]) -> list[int | None]:
    """The number of that of the found places which is each true one's (t,), None where there is none."""
    apart = np.linalg.norm(true[:, None] - found, axis=2)
    # How far apart those are that are none does not matter.
    pairs = dict(zip(*linear_sum_assignment(np.minimum(apart, _FAR_M)), strict=True))
    return [int(pairs[t]) if t in pairs and apart[t, pairs[t]] < _FAR_M else None for t in range(len(true))]


def _row(
    now: Tracked, contact: int | None, axes: Sequence[int]
) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Place and its standard deviation, force and its standard deviation of a contact, NaN without one."""
    if contact is None:
        nowhere = np.full(len(axes), np.nan)
        return nowhere, nowhere, np.nan, np.nan
    at, sigma = now.location_m[contact][axes], now.axis_sigma_m[contact][axes]
    return at, sigma, float(now.contact_force_N[contact]), float(now.contact_sigma_N[contact])
