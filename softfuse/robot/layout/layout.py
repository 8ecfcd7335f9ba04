"""Cavities in a body as a function of a few free parameters θ.

A layout names its parameters (p,), says in which unit and between which bounds they are, and computes from
them the values of every cavity: all that follows, from mesh to objective, is differentiated through `values`.
`TiedLayout` is the affine case: cavities as drawn at θ₀, and for each parameter how much it adds to which
values, v = v₀ + M (θ − θ₀). One parameter that adds to several cavities' values ties them: it mirrors where
it adds with opposite signs. Anything else is a class of the user's own:

    class Fan(AbstractLayout):
        ...
        def values(self, theta):
            angle = theta[0] * jnp.arange(3)
            return tuple(self.drawn.at[:2].set(...) for ...)
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.errors import SoftfuseError
from softfuse.mesh.block import Block
from softfuse.robot.layout.cavity_shape import CavityShape


@dataclass(frozen=True, eq=False)
class Parameter:
    """A free number: its name, where it starts, its bounds, and by how much it is usually changed, in its SI
    `unit` ("m", "rad" or "1").

    adds: value of a cavity, such as (0, "half x") -> how much of it the parameter adds.
    """

    name: str
    start: float
    lower: float
    upper: float
    unit: str = "m"
    scale: float | None = None
    adds: Mapping[tuple[int, str], float] = field(default_factory=dict)


class AbstractLayout(eqx.Module):
    """Cavities of the kinds `shapes` in an `outline`, a block whose own ones do not count, with parameters
    (p,) that are told by name, unit and bounds.
    """

    outline: eqx.AbstractVar[Block]
    shapes: eqx.AbstractVar[tuple[CavityShape, ...]]
    parameters: eqx.AbstractVar[tuple[Parameter, ...]]

    @abstractmethod
    def values(self, theta: Float[Array, " p"]) -> tuple[Float[Array, " v"], ...]:
        """The values (v,) of each cavity, see `CavityShape`, with parameters (p,); differentiable."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters (p,)."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def start(self) -> Float[np.ndarray, " p"]:
        """θ₀ (p,) in SI."""
        return np.array([parameter.start for parameter in self.parameters], float)

    @property
    def lower(self) -> Float[np.ndarray, " p"]:
        """Lower bounds (p,) in SI."""
        return np.array([parameter.lower for parameter in self.parameters], float)

    @property
    def upper(self) -> Float[np.ndarray, " p"]:
        """Upper bounds (p,) in SI."""
        return np.array([parameter.upper for parameter in self.parameters], float)

    @property
    def scale(self) -> Float[np.ndarray, " p"]:
        """By how much (p,) in SI each is usually changed: as told, or else a tenth of its range."""
        told = [parameter.scale for parameter in self.parameters]
        range_ = 0.1 * (self.upper - self.lower)
        return np.array([r if t is None else t for t, r in zip(told, range_, strict=True)], float)

    def points(
        self, theta: Float[Array, " p"], directions: Sequence[Float[Array | np.ndarray, "m 3"]]
    ) -> tuple[Float[Array, "m 3"], ...]:
        """Points (m, 3) [m] of each cavity along its unit directions (m, 3); differentiable in θ (p,)."""
        parts = zip(self.shapes, self.values(theta), directions, strict=True)
        return tuple(shape.points(values, along) for shape, values, along in parts)


class TiedLayout(AbstractLayout):
    """Cavities whose values change in proportion to the parameters: `drawn` (V,) are the values of all, one
    cavity after the other, at θ₀, `ties` (V, p) what each parameter adds.
    """

    outline: Block = eqx.field(static=True)
    shapes: tuple[CavityShape, ...]
    parameters: tuple[Parameter, ...] = eqx.field(static=True)
    drawn: Float[Array, " V"]
    ties: Float[Array, "V p"]

    @classmethod
    def of(
        cls,
        outline: Block,
        cavities: Sequence[tuple[CavityShape, Mapping[str, float]]],
        parameters: Sequence[Parameter],
    ) -> "TiedLayout":
        """Cavities with values by name at θ₀, in SI (turns are 0 where not given), and the parameters.

        Raises SoftfuseError where a value is missing, or one or its cavity does not exist, or a start lies
        outside its bounds.
        """
        outline.check()
        places: dict[tuple[int, str], int] = {}
        drawn: list[float] = []
        for k, (shape, given) in enumerate(cavities):
            unknown = sorted(set(given) - set(shape.names))
            if unknown:
                raise SoftfuseError(
                    f"cavity {k} has no {unknown[0]!r}: its values are {', '.join(shape.names)}"
                )
            for name in shape.names:
                optional = name.startswith(("turn ", "harmonic "))
                if name not in given and not optional:
                    raise SoftfuseError(f"cavity {k} lacks {name!r}: give its value in SI")
                places[k, name] = len(drawn)
                drawn.append(given.get(name, 0.0))
        ties = np.zeros((len(drawn), len(parameters)))
        for j, parameter in enumerate(parameters):
            _check(parameter)
            for (k, name), amount in parameter.adds.items():
                if (k, name) not in places:
                    raise SoftfuseError(
                        f'parameter "{parameter.name}" adds to {name!r} of cavity {k}, which does not exist: '
                        f"there are {len(cavities)} cavities, numbered from 0; see CavityShape.names"
                    )
                ties[places[k, name], j] = amount
        shapes = tuple(shape for shape, _ in cavities)
        return cls(outline, shapes, tuple(parameters), jnp.array(drawn, float), jnp.asarray(ties))

    def values(self, theta):
        """v₀ + M (θ − θ₀), cavity by cavity."""
        whole = self.drawn + self.ties @ (theta - self.start)
        ends = np.cumsum([len(shape.names) for shape in self.shapes])[:-1]
        return tuple(jnp.split(whole, ends))


def _check(parameter: Parameter) -> None:
    if not parameter.lower <= parameter.start <= parameter.upper:
        raise SoftfuseError(
            f'parameter "{parameter.name}" starts at {parameter.start:g} {parameter.unit}, outside its '
            f"bounds {parameter.lower:g} to {parameter.upper:g}: move the start or a bound"
        )
    if not parameter.lower < parameter.upper:
        raise SoftfuseError(f'parameter "{parameter.name}" cannot change: leave it out, or widen its bounds')
