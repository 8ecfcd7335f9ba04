"""A reduced device in a file: one npz without pickled objects, with the mark of what it was made from."""

import os
import tempfile
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from softfuse.body.body import Body
from softfuse.errors import SoftfuseError
from softfuse.estimation.device import Device
from softfuse.functional.base import AbstractFunctional
from softfuse.functional.cavity import Cavity
from softfuse.reduction.basis import Basis
from softfuse.reduction.body_arrays import Arrays, body_arrays, body_of
from softfuse.reduction.projected_volume import ProjectedVolumes
from softfuse.reduction.reduced_body import ReducedBody
from softfuse.reduction.rolling_inverse import ReducedDense

_VOLUMES = ("slope", "directions", "bend", "twist")


class Sizes(NamedTuple):
    """How many points of each material and how many watched nodes a reduced device has."""

    points: tuple[int, ...]
    watched: int


class Kept(NamedTuple):
    """A reduced device, ready for live steps, and the basis of its body."""

    device: Device
    basis: Basis


def write_device(path: Path, device: Device, basis: Basis, mark: str) -> None:
    """Write a device with a body that was projected onto a basis; its file appears when it is whole.

    Raises OSError when it cannot be written.
    """
    assert isinstance(device.body, ReducedBody)
    body = body_arrays(device.body, basis)
    points = [len(each.volumes) for each in device.body.sample]
    arrays = {"mark": np.array(mark), "points": np.array(points), **body}
    for number, sensor in enumerate(device.sensors):
        if isinstance(sensor, ProjectedVolumes):
            arrays |= {f"{name}{number}": np.asarray(getattr(sensor, name)) for name in _VOLUMES}
    path.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=path.parent) as aside:
        part = Path(aside) / path.name
        with part.open("wb") as stream:
            np.savez(stream, **arrays, allow_pickle=False)
        os.replace(part, path)


def kept_sizes(path: Path, mark: str) -> Sizes:
    """The sizes of the device in a file; raises SoftfuseError as `read_device` does."""
    arrays = _read(path, mark, ("points", "watched"))
    return Sizes(tuple(arrays["points"].tolist()), len(arrays["watched"]))


def read_device(path: Path, mark: str, full: Device, sizes: Sizes) -> Kept:
    """The device of a file, in the given sizes, at least its own; what it shares is the `full` one's.

    Raises SoftfuseError when there is none, it is damaged, or it was made from something else than `mark`
    says.
    """
    assert isinstance(full.body, Body)
    arrays = _read(path, mark)
    body = body_of(full.body, arrays, sizes.points, sizes.watched)
    sensors: list[AbstractFunctional] = []
    for kind, group in groupby(full.sensors, type):
        sensors += [_volumes(len(sensors), arrays)] if kind is Cavity else group
    device = replace(full, body=body, sensors=tuple(sensors), linear=ReducedDense.plan(body))
    return Kept(device, Basis(arrays["displacement"], arrays["pressure"]))


def _volumes(number: int, arrays: Arrays) -> ProjectedVolumes:
    """The functional with this number among the device's."""
    return ProjectedVolumes(*(jnp.asarray(arrays[f"{name}{number}"]) for name in _VOLUMES))


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
