"""A reduced device in a file: one npz without pickled objects, with the mark of what it was made from."""

import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import fields
from pathlib import Path
from typing import NamedTuple, TypeVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from softfuse.errors import SoftfuseError
from softfuse.io.result_folder import put_in_place
from softfuse.mechanics.load import AbstractContact, AbstractLoad
from softfuse.mechanics.model import Model, parts_of
from softfuse.mechanics.reading import AbstractReading, ShapeReading
from softfuse.rom.basis import Basis
from softfuse.rom.body_arrays import Arrays, body_arrays, body_of, of_nodes
from softfuse.rom.known_inverses import KnownInverses, ReducedDense
from softfuse.rom.projected_ports import (
    ProjectedGuides,
    ProjectedPatches,
    ProjectedVolumePorts,
    projected_discs,
)
from softfuse.rom.projected_volume import ProjectedVolumes
from softfuse.rom.reduced_body import ReducedBody
from softfuse.rom.reduced_model import volume_readings
from softfuse.rom.telling_unknowns import Telling, telling, telling_unknowns

_Part = ProjectedVolumes | ProjectedGuides | ProjectedPatches | KnownInverses
"""What has nothing but arrays."""
_Kind = TypeVar("_Kind", ProjectedVolumes, ProjectedGuides, ProjectedPatches, KnownInverses)


class Sizes(NamedTuple):
    """How many points of each material and how many watched nodes a reduced device has."""

    points: tuple[int, ...]
    watched: int


class Kept(NamedTuple):
    """A reduced device, ready for live steps, the basis of its body, by which of the full body's unknowns its
    modes of displacement and of pressure are told, and the displacements (3 k, m) [m] of all nodes by each
    displacement mode, node by node.
    """

    device: Model
    basis: Basis
    telling: tuple[Telling, Telling]
    nodal: Float[np.ndarray, "3k m"]

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


def write_device(path: Path, device: Model, basis: Basis, mark: str) -> None:
    """Write a device with a body that was projected onto a basis; its file appears when it is whole.

    Raises OSError when it cannot be written.
    """
    (body,) = parts_of(device.body, ReducedBody)
    arrays = {"mark": np.array(mark), **body_arrays(body, basis)}
    arrays |= {f"telling.{kind}": telling_unknowns(modes) for kind, modes in basis._asdict().items()}
    for name, part in _projected_parts(device):
        arrays |= {f"{name}.{each.name}": np.asarray(getattr(part, each.name)) for each in fields(part)}
    path.parent.mkdir(parents=True, exist_ok=True)
    with put_in_place(path) as part, part.open("wb") as stream:
        np.savez(stream, **arrays, allow_pickle=False)


def kept_sizes(path: Path, mark: str) -> Sizes:
    """The sizes of the device in a file; raises SoftfuseError as `read_device` does."""
    arrays = _read(path, mark, ("points", "watched"))
    return Sizes(tuple(arrays["points"].tolist()), len(arrays["watched"]))


def read_device(path: Path, mark: str, full: Model, sizes: Sizes) -> Kept:
    """The device of a file, in the given sizes, at least its own; what it shares is the `full` one's.

    Raises SoftfuseError when there is none, it is damaged, or it was made from something else than `mark`
    says.
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
    device = Model(body, tuple(readings), tuple(contacts), linear, actuators, full.slots)
    basis = Basis(arrays["displacement"], arrays["pressure"])
    nodal = of_nodes(whole, np.arange(whole.n_nodes), basis.displacement)
    told = (
        telling(basis.displacement, arrays["telling.displacement"]),
        telling(basis.pressure, arrays["telling.pressure"]),
    )
    return Kept(device, basis, told, nodal.reshape(-1, nodal.shape[-1]))


def _projected_parts(device: Model) -> Iterator[tuple[str, _Part]]:
    """What a reduced device has instead of the full one's parts, but for the body, by name."""
    several = {"reading": device.readings, "contact": device.contacts, "actuator": device.actuators}
    named = {f"{what}{k}": part for what, parts in several.items() for k, part in enumerate(parts)}
    for name, part in {"known": device.linear, **named}.items():
        for kept in parts_of(part, ProjectedVolumes, ProjectedGuides, ProjectedPatches, KnownInverses):
            yield name, kept


def _actuator(load: AbstractLoad, name: str, arrays: Arrays) -> AbstractLoad:
    """A load of the full device with the ports of some arrays, which are those of guides or of volumes."""
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
                raise SoftfuseError(f"{path} was made for another device: make it again with softfuse reduce")
            return {name: stored[name] for name in names or stored.files}
    except FileNotFoundError:
        raise SoftfuseError(f"{path} is missing: go on with softfuse reduce") from None
    except (OSError, ValueError, EOFError, KeyError, zipfile.BadZipFile) as error:
        raise SoftfuseError(
            f"{path} is damaged ({error}): delete it and go on with softfuse reduce"
        ) from error
