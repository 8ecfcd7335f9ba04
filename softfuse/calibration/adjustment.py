"""What a calibration may change of a robot: groups of parameters θ, each 0 as configured, with names and how
far from 0 they are expected to be.

Priors are normal, θ ~ N(0, σ²): for a stiffness θ is the logarithm of a factor, for a place a length, so that
σ says in which tolerance a robot is made. Everything is differentiable in θ.
"""

from collections.abc import Sequence
from enum import Enum
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.base import AbstractBody
from softfuse.body.stiffness_field import TERMS, with_field
from softfuse.material.base import constant
from softfuse.mechanics.model import Model, with_body
from softfuse.mesh.morph import wall_fields
from softfuse.mesh.tetmesh import TetMesh


class Measure(Enum):
    """What a parameter is."""

    factor = "the logarithm of a factor"
    ratio = "a ratio that is added"
    length = "a length [m]"
    angle = "an angle [rad]"


class AbstractAdjustment(eqx.Module):
    """Some parameters (p,) of one measure with prior standard deviations `sigma` (p,) and `names`, in SI."""

    measure: ClassVar[Measure] = Measure.factor
    of_cables: ClassVar[bool] = False
    """Whether only presses in which cables pull have to do with them."""
    sigma: eqx.AbstractVar[Float[Array, " p"]]
    names: eqx.AbstractVar[tuple[str, ...]]

    def adjusted(self, model: Model, value: Float[Array, " p"]) -> Model:
        """The robot with parameters (p,)."""
        del value
        return model

    def arms(
        self, arm: Float[Array, " c"], press: Int[Array, ""], value: Float[Array, " p"]
    ) -> Float[Array, " c"]:
        """How far [m] from the middles of their places contacts (c,) of a press act, for arms (c,) [m]."""
        del press, value
        return arm

    def prescribed(self, drive: Float[Array, " a"], value: Float[Array, " p"]) -> Float[Array, " a"]:
        """The drives of attached loads (a,) where (a,) were measured, in SI."""
        del value
        return drive

    def measured(self, reading: Float[Array, " k"], value: Float[Array, " p"]) -> Float[Array, " k"]:
        """What the sensors say (k,) where the robot's readings are (k,)."""
        del value
        return reading


class Stiffness(AbstractAdjustment):
    """θ (1,): all moduli times exp θ."""

    sigma: Float[Array, " 1"]
    names: tuple[str, ...] = eqx.field(static=True, default=("stiffness",))

    @classmethod
    def within(cls, sigma: float) -> Self:
        """With a prior standard deviation [-]."""
        return cls(jnp.array([sigma]))

    def adjusted(self, model, value):
        """The robot of stiffer or softer materials."""
        body = model.body.full
        materials = [law.times(jnp.exp(value[0])) for law in body.materials]
        return with_body(model, body.with_materials(materials))


class Stiffening(AbstractAdjustment):
    """θ (1,): Yeoh's c₂ more by θ c₁ in each material, neo-Hookean ones being Yeoh's with c₁ = μ/2."""

    measure: ClassVar[Measure] = Measure.ratio
    sigma: Float[Array, " 1"]
    names: tuple[str, ...] = eqx.field(static=True, default=("stiffening",))

    @classmethod
    def within(cls, sigma: float) -> Self:
        """With a prior standard deviation [-]."""
        return cls(jnp.array([sigma]))

    @staticmethod
    def possible(model: Model) -> bool:
        """Whether all its materials have such a constant."""
        return all(law.stiffened(0.0) is not law for law in model.body.full.materials)

    def adjusted(self, model, value):
        """The robot of materials that stiffen more or less under strain; see `possible`."""
        body = model.body.full
        return with_body(model, body.with_materials([law.stiffened(value[0]) for law in body.materials]))


class Layer(AbstractAdjustment):
    """θ (1,): the compliance of what lies between disc and body is `typical` [m/Pa] times exp θ."""

    sigma: Float[Array, " 1"]
    typical: Float[Array, ""] = eqx.field(converter=constant)
    names: tuple[str, ...] = eqx.field(static=True, default=("layer",))

    @classmethod
    def of(cls, compliance: float, radius: float, body: AbstractBody, sigma: float) -> Self:
        """Of the configured compliance [m/Pa], or where there is none of one that is felt as little as a
        hundredth of the disc's radius [m] of the body; with a prior standard deviation [-].
        """
        typical = compliance or 0.01 * radius / body.pressure_unit
        return cls(sigma=jnp.array([sigma]), typical=typical)

    def adjusted(self, model, value):
        """The robot pressed through such a layer."""
        compliance = self.typical * jnp.exp(value[0])
        return eqx.tree_at(lambda d: d.contacts[0].compliance, model, compliance)


class Walls(AbstractAdjustment):
    """θ (p,) [m]: how far cavities were made from where they are drawn, by modes (p, n, 3) [-] of nodes."""

    measure: ClassVar[Measure] = Measure.length
    sigma: Float[Array, " p"]
    modes: Float[Array, "p n 3"]
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        mesh: TetMesh,
        centres: Float[np.ndarray, "k 3"],
        names: Sequence[str],
        *,
        shift: float,
        growth: float,
    ) -> Self:
        """Shifts and growths along x, y, z of the cavities with centres (k, 3) m and names in a mesh, with
        prior standard deviations [m], 0 for those that are not fitted: see `mesh.morph`.
        """
        fields = wall_fields(mesh, centres=centres)
        sigma, modes, said = [], [], []
        for what, width, first in (("shift", shift, 0), ("growth", growth, 1)):
            if not width > 0:
                continue
            for name, field in zip(names, fields, strict=True):
                for axis in range(3):
                    mode = np.zeros((len(mesh.nodes), 3))
                    mode[:, axis] = field[0] if first == 0 else field[1 + axis]
                    sigma.append(width)
                    modes.append(mode)
                    said.append(f"{name} {what} {'xyz'[axis]}")
        whole = np.array(modes).reshape(-1, len(mesh.nodes), 3)
        return cls(sigma=jnp.array(sigma, float), modes=jnp.asarray(whole), names=tuple(said))

    def adjusted(self, model, value):
        """The robot with its cavities as made."""
        body = model.body.full
        return with_body(model, body.with_rest(body.rest + jnp.einsum("p,pni->ni", value, self.modes)))


class StiffnessField(AbstractAdjustment):
    """θ (9,): coefficients of the stiffness field beyond `configured` (9,), see `body.stiffness_field`."""

    sigma: Float[Array, "9"]
    configured: Float[Array, "9"]
    names: tuple[str, ...] = eqx.field(
        static=True, default=tuple(f"stiffness field {term}" for term in TERMS)
    )

    @classmethod
    def within(cls, sigma: float, configured: Sequence[float]) -> Self:
        """With a prior standard deviation of each coefficient [-]."""
        return cls(sigma=jnp.full(len(TERMS), sigma), configured=jnp.array(configured, float))

    def adjusted(self, model, value):
        """The robot that is stiffer in some parts than in others."""
        return with_body(model, with_field(model.body.full, self.configured + value))


class Gains(AbstractAdjustment):
    """θ (g,): each of the readings with `numbers` (g,) times exp θ."""

    sigma: Float[Array, " g"]
    numbers: Int[Array, " g"]
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, names: Sequence[str], having: Bool[np.ndarray, " k"], sigma: float) -> Self:
        """Of those readings with names (k,) that have a gain, with a prior standard deviation [-]."""
        numbers = np.flatnonzero(having)
        own = tuple(f"{names[int(k)]} gain" for k in numbers)
        return cls(sigma=jnp.full(len(own), sigma), numbers=jnp.asarray(numbers), names=own)

    def measured(self, reading, value):
        """Readings of sensors that say more or less than the truth."""
        # Reverse derivatives of a product want to know that no reading counts twice.
        return reading.at[self.numbers].multiply(jnp.exp(value), unique_indices=True)


class Adjustments(eqx.Module):
    """Groups of parameters, one after the other."""

    groups: tuple[AbstractAdjustment, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Of all parameters (p,)."""
        return tuple(name for group in self.groups for name in group.names)

    @property
    def measures(self) -> tuple[Measure, ...]:
        """What each of them is (p,)."""
        return tuple(group.measure for group in self.groups for _ in group.names)

    @property
    def sigma(self) -> Float[Array, " p"]:
        """Prior standard deviations (p,)."""
        return jnp.concatenate([jnp.zeros(0), *(group.sigma for group in self.groups)])

    def of_group(self, value: Float[Array | np.ndarray, " p"]) -> list[Float[Array, " _"]]:
        """The parameters (p,) group by group."""
        ends = np.cumsum([len(group.names) for group in self.groups])[:-1]
        return jnp.split(jnp.asarray(value), ends)

    def adjusted(self, model: Model, value: Float[Array | np.ndarray, " p"]) -> Model:
        """The robot with parameters (p,)."""
        for group, part in zip(self.groups, self.of_group(value), strict=True):
            model = group.adjusted(model, part)
        return model

    def arms(
        self, arm: Float[Array, " c"], press: Int[Array, ""], value: Float[Array, " p"]
    ) -> Float[Array, " c"]:
        """How far [m] from the middles of their places contacts (c,) of a press act, for arms (c,) [m]."""
        for group, part in zip(self.groups, self.of_group(value), strict=True):
            arm = group.arms(arm, press, part)
        return arm

    def prescribed(self, drive: Float[Array, " a"], value: Float[Array, " p"]) -> Float[Array, " a"]:
        """The drives of attached loads (a,) where (a,) were measured, in SI."""
        for group, part in zip(self.groups, self.of_group(value), strict=True):
            drive = group.prescribed(drive, part)
        return drive

    def measured(self, reading: Float[Array, " k"], value: Float[Array, " p"]) -> Float[Array, " k"]:
        """What the sensors say (k,) where the robot's readings are (k,)."""
        for group, part in zip(self.groups, self.of_group(value), strict=True):
            reading = group.measured(reading, part)
        return reading
