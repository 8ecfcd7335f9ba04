"""How the guides of cables follow the parameters of a design."""

from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.design.plan import AXES, DesignPlan
from softfuse.errors import ConfigError
from softfuse.mechanics.cable import PulledCable
from softfuse.mechanics.model import Model, with_actuators
from softfuse.robot.settings import RobotSettings


class CableRoute(eqx.Module):
    """Guides of each cable, drawn (g, 3) m, and what each parameter (p,) adds to them (g, 3, p); parameters
    are 0 as drawn.
    """

    drawn: tuple[Float[np.ndarray, "g 3"], ...]
    ties: tuple[Float[np.ndarray, "g 3 p"], ...]

    @classmethod
    def of(cls, plan: DesignPlan, config: RobotSettings) -> "CableRoute":
        """Of a plan; raises ConfigError when the robot has no such cable or guide."""
        drawn = [np.array(cable.guides) for cable in config.cables]
        ties = [np.zeros((*guides.shape, len(plan.parameters))) for guides in drawn]
        names = [cable.name for cable in config.cables]
        for j, parameter in enumerate(plan.parameters):
            for i, tie in enumerate(parameter.adds):
                if tie.cable is None:
                    continue
                key = f"{plan.path}: parameter[{j}].adds[{i}]"
                if tie.cable not in names:
                    raise ConfigError(
                        f'{key}.cable: {config.path} has no cable "{tie.cable}": it has '
                        f"{', '.join(names) or 'none'}"
                    )
                cable = names.index(tie.cable)
                count = len(drawn[cable])
                for guide in range(count) if tie.guides is None else tie.guides:
                    if guide >= count:
                        raise ConfigError(f"{key}.guides: {guide} is none of 0 to {count - 1}")
                    ties[cable][guide, AXES.index(tie.value), j] += tie.times
        return cls(tuple(drawn), tuple(ties))

    def guides(self, theta: Float[Array, " p"]) -> tuple[Float[Array, "g 3"], ...]:
        """Of each cable (g, 3) m with parameters (p,); differentiable."""
        return tuple(
            jnp.asarray(drawn) + ties @ theta for drawn, ties in zip(self.drawn, self.ties, strict=True)
        )

    def configured(self, config: RobotSettings, theta: Float[np.ndarray, " p"]) -> RobotSettings:
        """The config with the guides of parameters (p,)."""
        cables = tuple(
            cable.model_copy(update={"guides": tuple(map(tuple, np.asarray(guides).tolist()))})
            for cable, guides in zip(config.cables, self.guides(jnp.asarray(theta)), strict=True)
        )
        return config.model_copy(update={"cables": cables})

    def on_model(self, model: Model, theta: Float[Array, " p"]) -> Model:
        """The robot, built with any guides, with those of parameters (p,); differentiable."""
        guides = iter(self.guides(theta))

        def moved(cable: PulledCable) -> PulledCable:
            return replace(cable, ports=cable.ports.moved_to(next(guides)))

        return with_actuators(model, PulledCable, moved)
