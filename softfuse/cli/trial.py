"""What `softfuse simulate` does to one kind of device, and what it then has to say."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from jaxtyping import Array, Float

from softfuse.mechanics.model import Model
from softfuse.mechanics.solution import State
from softfuse.robot.file import RobotSettings
from softfuse.robot.mesh import RobotMesh


@dataclass(frozen=True, eq=False)
class Asked:
    """A device and what the command line asks to be done to it: `force` [N] in all, texts as they stand
    there; None for what is not given.
    """

    config: RobotSettings
    device: Model
    mesh: RobotMesh
    force: float | None
    at: str | None
    contact: str | None
    electrode: str | None
    cables: list[str]


class AbstractTrial(ABC):
    """Contacts and drives of a device, and what is told about the equilibrium."""

    @property
    @abstractmethod
    def device(self) -> Model:
        """The device, changed as is needed."""

    @property
    @abstractmethod
    def places(self) -> Array:
        """Where it is pressed (c, ...)."""

    @property
    @abstractmethod
    def drive(self) -> Float[Array, " D"]:
        """Forces of the contacts, then what the attached loads prescribe."""

    @abstractmethod
    def numbers(self, state: State) -> dict[str, Any]:
        """What the file of numbers holds besides how the search went."""

    @abstractmethod
    def told(self, numbers: dict[str, Any]) -> str:
        """What is said on the terminal."""
