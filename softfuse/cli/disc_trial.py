"""A disc pressed onto a device from outside, at any place."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from softfuse.cli.trial import AbstractTrial, Asked
from softfuse.config.build_device import with_contact_model
from softfuse.errors import SoftfuseError
from softfuse.functional.chart import facing
from softfuse.mechanics.model import Model
from softfuse.mechanics.punch import PunchContact


class DiscTrial(AbstractTrial):
    """A disc with a force at a place."""

    def __init__(self, asked: Asked):
        """Raises SoftfuseError when the place is missing or the disc overhangs, or for other options."""
        if asked.electrode is not None or asked.cables:
            raise SoftfuseError("this device is pressed by a disc: say where with --at X,Y in mm")
        if asked.at is None:
            raise SoftfuseError("--at is missing: give the centre of the contact, X,Y in mm")
        if asked.force is None:
            raise SoftfuseError("--force is missing: give the total force in N")
        self._location = parse_location(asked.at)
        self._force = asked.force
        device = asked.device
        self._device = device if asked.contact is None else with_contact_model(device, asked.contact)
        check_on_body(self._device, self._location)

    @property
    def device(self):
        """With the disc that was asked for."""
        return self._device

    @property
    def places(self):
        """Its centre."""
        disc = self._device.contacts[0]
        assert isinstance(disc, PunchContact)  # `check_on_body` has told
        return jnp.asarray(facing(self._location[None], np.asarray(disc.disc.surface.direction)))

    @property
    def drive(self):
        """Its force."""
        return jnp.array([float(self._force)])

    def numbers(self, state) -> dict[str, Any]:
        """Force, depth and volume changes."""
        return {
            "force_N": float(state.drive[0]),
            "depth_mm": 1e3 * float(state.internal[0]),
            "volume_change_mm3": [1e9 * float(v) for v in self._device.reading(state, self.places)],
        }

    def told(self, numbers):
        """In one line."""
        x, y = 1e3 * self._location[:2]
        volumes = ", ".join(f"{v:.2f}" for v in numbers["volume_change_mm3"])
        return (
            f"{self._force:g} N at ({x:g}, {y:g}) mm: depth {numbers['depth_mm']:.4f} mm, "
            f"volume changes {volumes} mm³ ({numbers['nodes']} nodes, "
            f"{numbers['newton_iterations']} iterations)"
        )


def parse_location(text: str) -> np.ndarray:
    """X,Y in mm as (x, y, 0) in m; raises SoftfuseError when the text is something else."""
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise SoftfuseError(f'--at "{text}" is not a place: give X,Y in mm, such as --at 10,-6') from None
    return 1e-3 * np.array([x, y, 0.0])


def check_on_body(device: Model, location: np.ndarray) -> None:
    """Raise SoftfuseError unless the whole disc stands on the body."""
    contact = device.contacts[0]
    if not isinstance(contact, PunchContact):
        raise SoftfuseError("this device is pressed at its electrodes, not at any place by a disc")
    disc = contact.at(jnp.asarray(location)[None])
    if float(disc.overlap(device.body)) < 1.0:
        points = np.asarray(device.body.rest)[np.unique(disc.surface.faces)]
        low, high = 1e3 * points.min(axis=0), 1e3 * points.max(axis=0)
        raise SoftfuseError(
            f"the contact at ({1e3 * location[0]:g}, {1e3 * location[1]:g}) mm with radius "
            f"{1e3 * float(disc.radius):g} mm overhangs the surface, which spans "
            f"x {low[0]:g} to {high[0]:g} mm and y {low[1]:g} to {high[1]:g} mm: move it inwards"
        )
