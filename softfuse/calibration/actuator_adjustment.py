"""What a calibration may change of actuators: cables, and gas sealed in chambers.

A robot is fitted with its cables shortened by what was measured, whatever tension that takes.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import ClassVar, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.calibration.adjustment import AbstractAdjustment, Measure
from softfuse.mechanics.cable import ShortenedCable
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.model import Model, parts_of, with_actuators

_TYPICAL_STRAIN = 1e-3
"""Of a cable under the largest tension, where none is configured: a wire's is some ten-thousandths, that of
braided line a percent. So small a one hardly shows where presses do not tell another.
"""


class CableZeros(AbstractAdjustment):
    """θ (b,) [m]: what is read of a cable where it gets taut, beyond the zero that is configured."""

    measure: ClassVar[Measure] = Measure.length
    of_cables: ClassVar[bool] = True
    sigma: Float[Array, " b"]
    number: Int[Array, " b"]
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, cables: Sequence[str], number: Int[np.ndarray, " b"], sigma: float) -> Self:
        """Of cables with numbers (b,) among the actuators' drives, with a prior standard deviation [m]."""
        names = tuple(f"{name} zero" for name in cables)
        return cls(sigma=jnp.full(len(cables), sigma), number=jnp.asarray(number), names=names)

    def prescribed(self, drive, value):
        """Lengths by which cables are shorter than where they get taut."""
        return drive.at[self.number].add(-value)


class CableCompliances(AbstractAdjustment):
    """θ (b,): the compliance of each cable itself is `typical` (b,) [m/N] times exp θ."""

    of_cables: ClassVar[bool] = True
    sigma: Float[Array, " b"]
    typical: Float[Array, " b"]
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, model: Model, cables: Sequence[str], most_N: Sequence[float], sigma: float) -> Self:
        """Of the configured compliances, or where there is none of one that is felt as a strain of a
        thousandth under the largest tension [N]; with a prior standard deviation [-].
        """
        loads = zip(parts_of(model.actuators, ShortenedCable), most_N, strict=True)
        typical = [
            float(load.compliance) or _TYPICAL_STRAIN * float(load.rest_length) / most for load, most in loads
        ]
        names = tuple(f"{name} compliance" for name in cables)
        return cls(sigma=jnp.full(len(cables), sigma), typical=jnp.array(typical), names=names)

    def adjusted(self, model, value):
        """The robot of softer or stiffer cables."""
        each = iter(self.typical * jnp.exp(value))
        return with_actuators(model, ShortenedCable, lambda cable: replace(cable, compliance=next(each)))


class DeadVolumes(AbstractAdjustment):
    """θ (k,): the dead volume of each sealed chamber times exp θ."""

    sigma: Float[Array, " k"]
    names: tuple[str, ...] = eqx.field(static=True)

    @classmethod
    def of(cls, chambers: Sequence[str], sigma: float) -> Self:
        """Of the gas in sealed chambers, in the order of their drives; prior standard deviation [-]."""
        names = tuple(f"{name} dead volume" for name in chambers)
        return cls(sigma=jnp.full(len(chambers), sigma), names=names)

    def adjusted(self, model, value):
        """The model with more or less gas behind its chambers."""
        left = jnp.exp(value)

        def filled(gas: SealedGas) -> SealedGas:
            nonlocal left
            own, left = jnp.split(left, [gas.dead.shape[0]])
            return replace(gas, dead=gas.dead * own)

        return with_actuators(model, SealedGas, filled)
