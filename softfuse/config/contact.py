"""What presses on the body, and where and how hard it may."""

from abc import abstractmethod
from collections.abc import Sequence
from typing import Annotated, Literal

import jax.numpy as jnp
import numpy as np
from annotated_types import Ge
from jaxtyping import Float, Int
from pydantic import Field

from softfuse.config.attached import ElectrodePlace
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import PressureCells, flat_punch, uniform
from softfuse.io.quantity import (
    LayerCompliance,
    PositiveForce,
    PositiveInteger,
    PositiveLength,
    wrong_value,
)
from softfuse.io.settings import Direction, Range, Settings
from softfuse.mechanics.load import AbstractContact
from softfuse.mechanics.patch import PatchContact
from softfuse.mechanics.punch import PunchContact


class Workspace(Settings):
    """Where the centre of a contact may be: ranges of x and y in m."""

    x: Range
    y: Range


class ContactSettings(Settings):
    """Something of radius m that presses with at most max_force N."""

    radius: PositiveLength
    max_force: PositiveForce

    @abstractmethod
    def contact(
        self,
        faces: Int[np.ndarray, "f s"],
        rest: Float[np.ndarray, "k 3"],
        electrodes: Sequence[ElectrodePlace],
    ) -> AbstractContact:
        """The contact on the outward faces (f, s) of a body with nodes at `rest` (k, 3) m and electrodes."""

    @abstractmethod
    def check_electrodes(self, electrodes: Sequence[ElectrodePlace]) -> None:
        """Raise the error of a validator when the [[electrode]] do not suit the contact."""

    @abstractmethod
    def forces(self, electrodes: Sequence[ElectrodePlace]) -> int:
        """With how many forces one contact is driven."""


class DiscSettings(ContactSettings):
    """Discs that push along direction (3,) anywhere in the workspace; at most max_contacts at once.

    compliance in m/Pa: of a soft layer between disc and body, a padded indenter or a skin that the mesh does
    not have; 0: none.
    """

    direction: Direction
    workspace: Workspace
    max_contacts: PositiveInteger = 1
    compliance: Annotated[LayerCompliance, Ge(0)] = 0.0

    @staticmethod
    @abstractmethod
    def cells() -> PressureCells:
        """How its force may be distributed."""

    def contact(self, faces, rest, electrodes):
        """A disc on those of the faces that look against its direction."""
        del electrodes
        surface = ContactSurface.facing(faces, rest, np.array(self.direction))
        disc = Contact(surface, self.cells(), jnp.zeros(3), jnp.asarray(self.radius), self.compliance)
        return PunchContact(disc)

    def check_electrodes(self, electrodes):
        """A disc needs none."""

    def forces(self, electrodes):
        """The total one."""
        del electrodes
        return 1


class PunchSettings(DiscSettings):
    """A rigid flat indenter."""

    model: Literal["punch"]

    @staticmethod
    def cells():
        """Ring sectors whose forces follow from equal displacement."""
        return flat_punch()


class UniformSettings(DiscSettings):
    """The same pressure everywhere under the disc."""

    model: Literal["uniform"]

    @staticmethod
    def cells():
        """One cell."""
        return uniform()


_PATCH_RINGS, _PATCH_ANGLES = 3, 12


class PatchSettings(ContactSettings):
    """Patches at the electrodes, pressed along their current normals; at most max_contacts at once.

    max_force bounds the force on each patch; place_sigma in m: standard deviation of where on its electrode a
    contact presses around the middle, None: anywhere.
    """

    model: Literal["patch"]
    max_contacts: PositiveInteger
    place_sigma: PositiveLength | None = None

    def contact(self, faces, rest, electrodes):
        """The patches of each electrode, on whatever face it lies."""
        del rest
        return PatchContact.on(
            faces,
            uniform(rings=_PATCH_RINGS, angles=_PATCH_ANGLES),
            self.radius,
            electrodes[0].arms,
        )

    def check_electrodes(self, electrodes):
        """Contacts are at electrodes, so there are not more of them; all have as many patches."""
        count = len(electrodes)
        if not count:
            raise wrong_value(
                "a patch is pressed where an electrode is: add [[electrode]] with name, centre and direction",
                key="contact.model",
            )
        if self.max_contacts > count:
            raise wrong_value(
                f"{self.max_contacts} contacts at once on {count} electrodes: "
                f"give a number from 1 to {count}",
                key="contact.max_contacts",
            )
        first = electrodes[0].arms
        for k, electrode in enumerate(electrodes):
            if not np.allclose(electrode.arms[-1], first[-1], rtol=1e-9, atol=0.0):
                raise wrong_value(
                    "give all electrodes spans of the same length, or none", key=f"electrode[{k}].span"
                )

    def forces(self, electrodes):
        """One on each patch of an electrode."""
        return len(electrodes[0].arms)


AnyContact = Annotated[PunchSettings | UniformSettings | PatchSettings, Field(discriminator="model")]
