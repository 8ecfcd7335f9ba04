"""Reduced robots in files: npz without pickled objects, with the mark of what they were made from.

A robot has one for each region where contacts may be, a chart, which is read when asked for.
"""

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.linalg
from jaxtyping import Float, Int

from softfuse.errors import SoftfuseError
from softfuse.io.result_folder import put_in_place
from softfuse.mechanics.load import AbstractContact, AbstractLoad
from softfuse.mechanics.model import Model, parts_of
from softfuse.mechanics.reading import AbstractReading, ShapeReading
from softfuse.rom.basis import Basis
from softfuse.rom.cells import AbstractRegions
from softfuse.rom.known_inverses import KnownInverses, ReducedDense
from softfuse.rom.projected_ports import (
    ProjectedGuides,
    ProjectedPatches,
    ProjectedVolumePorts,
    projected_discs,
)
from softfuse.rom.projected_volume import ProjectedVolumes
from softfuse.rom.projection import Arrays, body_arrays, body_of, of_nodes
from softfuse.rom.reduced_body import ReducedBody
from softfuse.rom.reduced_model import volume_readings

_ROUNDS = 2
"""Times as many unknowns as modes, so that what no mode makes is averaged."""

_Part = ProjectedVolumes | ProjectedGuides | ProjectedPatches | KnownInverses
"""What has nothing but arrays."""

_Kind = TypeVar("_Kind", bound=eqx.Module)


class Telling(NamedTuple):
    """Which `unknowns` (s,) of the full body, and the amplitudes `of_them` (r, s)."""

    unknowns: Int[np.ndarray, " s"]
    of_them: Float[np.ndarray, "r s"]


def telling_unknowns(modes: Float[np.ndarray, "u r"]) -> Int[np.ndarray, " s"]:
    """The rows (s,) of modes that tell these apart best: pivots of them all, then of those that are left.

    When a contact goes from one chart to the next, its state does too. The amplitudes that come closest to it
    in energy ask for every unknown of the full body, a few milliseconds; a few hundred unknowns, matched by
    least squares, give amplitudes that differ by less than the charts do. Source for the choice by pivoted
    QR: Drmač and Gugercin, SIAM J. Sci. Comput. 38, 2016 (Q-DEIM).
    """
    chosen = np.zeros(0, int)
    for _ in range(_ROUNDS):
        left = np.setdiff1d(np.arange(len(modes)), chosen)
        pivots = np.asarray(scipy.linalg.qr(modes[left].T, mode="r", pivoting=True)[-1])
        chosen = np.append(chosen, left[pivots[: modes.shape[1]]])
    return chosen


def telling(modes: Float[np.ndarray, "u r"], unknowns: Int[np.ndarray, " s"]) -> Telling:
    """Amplitudes of modes from the unknowns (s,) that tell them apart."""
    return Telling(unknowns, np.linalg.pinv(modes[unknowns].astype(float)))


class Sizes(NamedTuple):
    """How many points of each material and how many watched nodes a reduced robot has."""

    points: tuple[int, ...]
    watched: int


class Kept(NamedTuple):
    """A reduced robot, ready for live steps, the basis of its body, by which of the full body's unknowns its
    modes of displacement and of pressure are told, and the displacements (3 k, m) [m] of all nodes by each
    displacement mode, node by node.
    """

    model: Model
    basis: Basis
    telling: tuple[Telling, Telling]
    nodal: Float[np.ndarray, "three_k m"]

    def displacement(
        self, z: Float[np.ndarray, " r"], modes: slice | None = None
    ) -> Float[np.ndarray, "k 3"]:
        """Displacements (k, 3) m of all nodes by some displacement modes, or by all, at amplitudes z (r,)."""
        modes = slice(self.nodal.shape[1]) if modes is None else modes
        return (self.nodal[:, modes] @ z[modes].astype(self.nodal.dtype)).reshape(-1, 3)

    def amplitudes_of(self, other: "Kept", z: Float[np.ndarray, " q"]) -> Float[np.ndarray, " r"]:
        """Amplitudes (r,) of the shape that another reduction of the same body has at its own z (q,)."""
        m = other.basis.displacement.shape[1]
        parts = zip(self.telling, other.basis, (z[:m], z[m:]), strict=True)
        return np.concatenate([told.of_them @ (modes[told.unknowns] @ of) for told, modes, of in parts])


def write_model(path: Path, model: Model, basis: Basis, mark: str) -> None:
    """Write a robot with a body that was projected onto a basis; its file appears when it is whole.

    Raises OSError when it cannot be written.
    """
    (body,) = parts_of(model.body, ReducedBody)
    arrays = {"mark": np.array(mark), **body_arrays(body, basis)}
    arrays |= {f"telling.{kind}": telling_unknowns(modes) for kind, modes in basis._asdict().items()}
    for name, part in _projected_parts(model):
        arrays |= {f"{name}.{each.name}": np.asarray(getattr(part, each.name)) for each in fields(part)}
    path.parent.mkdir(parents=True, exist_ok=True)
    with put_in_place(path) as part, part.open("wb") as stream:
        np.savez(stream, **arrays, allow_pickle=False)


def kept_sizes(path: Path, mark: str) -> Sizes:
    """The sizes of the robot in a file; raises SoftfuseError as `read_model` does."""
    arrays = _read(path, mark, ("points", "watched"))
    return Sizes(tuple(arrays["points"].tolist()), len(arrays["watched"]))


def read_model(path: Path, mark: str, full: Model, sizes: Sizes) -> Kept:
    """The robot of a file, in the given sizes, at least its own; what it shares is the `full` one's.

    Raises SoftfuseError when there is none, it is damaged, or made from something else than `mark` says.
    """
    arrays, whole = _read(path, mark), full.body.full
    body = body_of(whole, arrays, sizes.points, sizes.watched)
    readings: list[AbstractReading] = []
    for number, (cavities, reading) in enumerate(volume_readings(full.readings)):
        if cavities:
            reading = ShapeReading(_part(ProjectedVolumes, f"reading{number}", arrays))
        readings.append(reading)
    contacts: list[AbstractContact] = []
    for number, contact in enumerate(full.contacts):
        name = f"contact{number}"
        at_places = f"{name}.points" in arrays
        contacts.append(
            _part(ProjectedPatches, name, arrays) if at_places else projected_discs(contact, body)
        )
    actuators = tuple(_actuator(load, f"actuator{k}", arrays) for k, load in enumerate(full.actuators))
    linear = ReducedDense.with_known(body, _part(KnownInverses, "known", arrays))
    model = Model(body, tuple(readings), tuple(contacts), linear, actuators, full.slots)
    basis = Basis(arrays["displacement"], arrays["pressure"])
    nodal = of_nodes(whole, np.arange(whole.n_nodes), basis.displacement)
    told = (
        telling(basis.displacement, arrays["telling.displacement"]),
        telling(basis.pressure, arrays["telling.pressure"]),
    )
    return Kept(model, basis, told, nodal.reshape(-1, nodal.shape[-1]))


def _projected_parts(model: Model) -> Iterator[tuple[str, _Part]]:
    """What a reduced robot has instead of the full one's parts, but for the body, by name."""
    several = {"reading": model.readings, "contact": model.contacts, "actuator": model.actuators}
    named = {f"{what}{k}": part for what, parts in several.items() for k, part in enumerate(parts)}
    for name, part in {"known": model.linear, **named}.items():
        for kept in parts_of(part, ProjectedVolumes, ProjectedGuides, ProjectedPatches, KnownInverses):
            yield name, kept


def _actuator(load: AbstractLoad, name: str, arrays: Arrays) -> AbstractLoad:
    """A load of the full robot with the ports of some arrays, which are those of guides or of volumes."""
    if f"{name}.springs" in arrays:
        ports = _part(ProjectedGuides, name, arrays)
    else:
        ports = ProjectedVolumePorts(_part(ProjectedVolumes, name, arrays))
    return eqx.tree_at(lambda of: of.ports, load, ports)


def _part(kind: type[_Kind], name: str, arrays: Arrays) -> _Kind:
    return kind(*(jnp.asarray(arrays[f"{name}.{each.name}"]) for each in fields(kind)))


def _read(path: Path, mark: str, names: Sequence[str] | None = None) -> Arrays:
    try:
        with np.load(path, allow_pickle=False) as stored:
            if str(stored["mark"]) != mark:
                raise SoftfuseError(f"{path} was made for another robot: make it again with softfuse reduce")
            return {name: stored[name] for name in names or stored.files}
    except FileNotFoundError:
        raise SoftfuseError(f"{path} is missing: go on with softfuse reduce") from None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise SoftfuseError(
            f"{path} is damaged ({error}): delete it and go on with softfuse reduce"
        ) from error


@dataclass(frozen=True)
class AtlasFolder:
    """Where charts are, and the `mark` of what they were made from."""

    path: Path
    mark: str

    def file(self, number: int) -> Path:
        """The file of a region's chart."""
        return self.path / f"chart-{number:04d}.npz"

    def has(self, number: int) -> bool:
        """Whether the chart of a region is there; raises SoftfuseError for one of another robot."""
        return self.file(number).exists() and bool(kept_sizes(self.file(number), self.mark))

    def write(self, number: int, model: Model, basis: Basis) -> None:
        """Write the chart of a region. Raises OSError when it cannot be written."""
        write_model(self.file(number), model, basis, self.mark)


class Atlas:
    """All charts of a full robot, in equal sizes."""

    def __init__(self, full: Model, regions: AbstractRegions, folder: AtlasFolder):
        """See that all charts are there. SoftfuseError when one is missing, damaged, or another robot's."""
        self.full, self.regions, self._folder = full, regions, folder
        missing = [number for number in range(len(regions)) if not folder.file(number).exists()]
        if missing:
            raise SoftfuseError(
                f"{len(missing)} of {len(regions)} charts are missing in {folder.path}: "
                "run softfuse reduce with this folder"
            )
        sizes = [kept_sizes(folder.file(number), folder.mark) for number in range(len(regions))]
        points = np.max([each.points for each in sizes], axis=0)
        self._sizes = Sizes(tuple(map(int, points)), max(each.watched for each in sizes))
        self._kept: dict[int, Kept] = {}

    def chart(self, number: int) -> Kept:
        """The chart of a region. Raises SoftfuseError when its file is gone or damaged."""
        if number not in self._kept:
            file, mark = self._folder.file(number), self._folder.mark
            self._kept[number] = read_model(file, mark, self.full, self._sizes)
        return self._kept[number]
