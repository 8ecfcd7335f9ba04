"""A soft pad as it comes out of the mould, unlike any model of it: for virtual devices and test beds.

It differs from the drawing in what an estimator does not know: Yeoh silicone that stiffens with strain,
cavities that are off their places and sizes, and its own mesh. The errors are uniform in ± their bound, drawn
from `seed`. It is pressed by a rigid flat round punch straight down (`equilibrium.punch`), bare or through a
skin, slowly; no gravity, no viscosity. z runs from the fixed bottom to the top, x and y are centred (see
`mesh.drawing`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.body import Body
from softfuse.body.element import TAYLOR_HOOD
from softfuse.errors import ConfigError, SolveError
from softfuse.functional.cavity import Cavity
from softfuse.functional.chart import facing
from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material.silicones import silicone_of_stiffness
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.load import Loads
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.newton import Newton, solve
from softfuse.mechanics.punch import PunchContact
from softfuse.mechanics.solution import RESULTS, State
from softfuse.mesh.drawing import AbstractBlockDrawing
from softfuse.mesh.morph import reshaped_cavities
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.mesh.tetmesh import quadratic

_DOWN = np.array([0.0, 0.0, -1.0])


@dataclass(frozen=True)
class PadErrors:
    """Bounds in m of how far each cavity is from its drawing, in each direction, and the seed of the draw."""

    cavity_place: float = 0.3e-3
    cavity_size: float = 0.2e-3
    seed: int = 1


@dataclass(frozen=True)
class PadSettings:
    """The drawing, what it is made of, how finely it is computed, and the punch; lengths in m.

    shear_modulus in Pa and poisson at small strains; with larger ones it stiffens as `silicone` does.
    surface_size, base_size, growth: see `mesh.pad.pad_mesh`. radius: of the punch; layer [m/Pa]: compliance
    of the skin between punch and pad; rims, sectors: its cells, see `functional.pressure_cells.flat_punch`. A
    coarse mesh cannot tell many apart, and there is no equilibrium.
    """

    drawing: AbstractBlockDrawing
    shear_modulus: float
    poisson: float = 0.49
    silicone: str = "dragon skin 30"
    surface_size: float = 14e-3
    base_size: float = 16e-3
    growth: float = 1.0
    radius: float = 10e-3
    layer: float = 0.0
    rims: tuple[float, ...] = (0.5, 0.85, 1.0)
    sectors: tuple[int, ...] = (4, 8, 12)
    errors: PadErrors = PadErrors()


@dataclass(frozen=True)
class Touch:
    """Where the punch's middle presses, x and y in m, and the increasing forces in N at which it rests."""

    at: tuple[float, float]
    forces: tuple[float, ...]

    def __post_init__(self) -> None:
        if not self.forces or any(b <= a for a, b in zip((0.0, *self.forces), self.forces, strict=False)):
            raise ConfigError(f"forces {self.forces} N: give positive ones that increase")

    def __str__(self) -> str:
        return f"({1e3 * self.at[0]:g}, {1e3 * self.at[1]:g}) mm"


@dataclass(frozen=True, eq=False)
class PadPose:
    """An equilibrium: force [N] and depth [m] of the punch, change of volume of the k cavities (k,) [m³],
    positions of the body's nodes (n, 3) [m].
    """

    force: float
    depth: float
    volume: Float[np.ndarray, " k"]
    nodes: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, eq=False)
class VirtualPad:
    """The body, its cavities in the order of the drawing, and what presses on it."""

    settings: PadSettings
    body: Body
    cavities: tuple[Cavity, ...]
    contact: PunchContact

    def volumes(self, positions: Float[Array, "n 3"]) -> Float[Array, " k"]:
        """Enclosed volumes (k,) m³ at node positions (n, 3) m."""
        return jnp.stack([cavity(positions) for cavity in self.cavities])


def virtual_pad(settings: PadSettings) -> VirtualPad:
    """Make the pad.

    Raises MeshError when errors and drawing do not go together, ConfigError for an unknown silicone.
    """
    rng, bound = np.random.default_rng(settings.errors.seed), settings.errors
    centres = settings.drawing.centres()
    drawn = settings.drawing.mesh(settings.surface_size, settings.base_size, growth=settings.growth)
    shifts = rng.uniform(-bound.cavity_place, bound.cavity_place, centres.shape)
    growths = rng.uniform(-bound.cavity_size, bound.cavity_size, centres.shape)
    mesh = quadratic(reshaped_cavities(drawn, shifts, growths, centres=centres))
    law = silicone_of_stiffness(settings.silicone, settings.shear_modulus, settings.poisson)
    bottom = mesh.nodes[:, 2] <= 1e-9 * settings.drawing.size[2]
    body = Body.from_mesh(mesh, (law,), bottom, element=TAYLOR_HOOD)
    surface = ContactSurface.facing(outer_surface(mesh).faces, mesh.nodes, _DOWN)
    cells = flat_punch(settings.rims, settings.sectors)
    disc = Contact(surface, cells, jnp.zeros(3), jnp.asarray(settings.radius), settings.layer)
    walls = tuple(Cavity(jnp.asarray(wall.faces)) for wall in cavities(mesh, centres))
    return VirtualPad(settings, body, walls, PunchContact(disc))


class PadSolver:
    """Equilibria of one virtual pad; one program is compiled for all touches."""

    def __init__(
        self, pad: VirtualPad, *, plan: Callable[[Body], AbstractLinearSolver] = Multifrontal.plan
    ) -> None:
        """plan: of the linear solver."""
        self._pad = pad
        self._newton = Newton(plan(pad.body))
        self._solve = eqx.filter_jit(solve)
        self._nodes = jax.jit(lambda z: pad.body.rest + pad.body.displacement(z))
        self._volumes = jax.jit(lambda z: pad.volumes(self._nodes(z)) - pad.volumes(pad.body.rest))

    def poses(self, touch: Touch, *, solved: Callable[[], None] | None = None) -> list[PadPose]:
        """The equilibria of a touch: first contact without force, then under each of its forces.

        `solved` is called after each of the latter. Raises ConfigError when the punch overhangs the pad,
        SolveError when an equilibrium is not found.
        """
        body, contact = self._pad.body, self._pad.contact
        place = jnp.asarray(facing(np.array([*touch.at, 0.0]), _DOWN))
        if float(contact.at(place).overlap(body)) < 1.0:
            raise ConfigError(f"the punch at {touch} overhangs the edge of the pad: move it inwards")
        loads = Loads((contact.load(body, place),))
        state = State.rest(body, loads)
        poses = [PadPose(0.0, 0.0, np.zeros(len(self._pad.cavities)), np.asarray(body.rest))]
        for force in touch.forces:
            found = self._solve(self._newton, body, loads, jnp.array([float(force)]), state)
            if not bool(found.result == RESULTS.converged):
                raise SolveError(
                    f"no equilibrium under {force:g} N at {touch}: {RESULTS[found.result]}; press less hard"
                )
            state = found.state
            volumes, nodes = np.asarray(self._volumes(state.z)), np.asarray(self._nodes(state.z))
            poses.append(PadPose(force, float(state.internal[0]), volumes, nodes))
            if solved is not None:
                solved()
        return poses
