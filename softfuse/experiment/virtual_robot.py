"""A robot as it comes out of the mould, unlike any model of it: for virtual boards and test beds.

It differs from its drawing in what an estimator does not know: silicone that stiffens with strain, of a
stiffness that is off by a part; chambers, guides of cables and named points off their places; a mesh with
more nodes; what presses has a skin of its own; and its sensors' parts, see `SensorSettings.electronics`. The
errors are uniform in ± their bound, drawn from a seed. Elastic and quasi-static: no viscosity, no friction
but at the cables' guides.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float

from softfuse.errors import ConfigError
from softfuse.io.settings import Vector
from softfuse.material.silicones import SILICONES, silicone_of_stiffness
from softfuse.mesh.surface import outer_surface, winding_number
from softfuse.robot.material import Material, YeohSettings
from softfuse.robot.mesh import RobotMesh, build_mesh
from softfuse.robot.robot import Robot, build_robot
from softfuse.robot.settings import RobotSettings

_RIMS, _SECTORS = (0.5, 0.85, 1.0), (4, 8, 12)
"""Cells of what presses, see `functional.pressure_cells`: a coarse mesh cannot tell many apart, and
there is no equilibrium.
"""

_FINER, _MOST_MESHES = 1.12, 10
"""By which edges get shorter from one mesh to the next until one has enough nodes, and how many are made."""

_NEARER = (1.0, 0.5, 0.25)
"""Parts of an error that are tried for a point that it would move out of the body."""


@dataclass(frozen=True)
class MakingErrors:
    """Bounds of errors in m, in each direction, and of that of all moduli as a part; the seed of their draw.

    silicone: as which the material stiffens, None: that whose stiffness is nearest; skin [m/Pa]: compliance
    of what lies between a disc and the body; nodes: so many times the nodes of the drawing's mesh, at least;
    0: its mesh.
    """

    chamber_place: float = 0.3e-3
    chamber_size: float = 0.2e-3
    guide: float = 0.3e-3
    anchor_radius: float = 0.3e-3
    point: float = 0.3e-3
    stiffness: float = 0.1
    silicone: str | None = None
    skin: float = 0.2e-9
    nodes: float = 2.0
    seed: int = 1


@dataclass(frozen=True, eq=False)
class VirtualRobot:
    """The robot as `made`, and as `drawn`: the points whose places are truth are those of the drawing."""

    drawn: RobotSettings
    errors: MakingErrors
    made: Robot

    @property
    def told(self) -> dict[str, str]:
        """What makes it differ from its drawing, for people."""
        errors, (material, *_) = self.errors, self.made.settings.body.materials
        factor = material.shear_modulus / self.drawn.body.materials[0].shear_modulus
        return {
            "material": f"stiffens with strain (Yeoh), stiffness off by {100 * (factor - 1):+.1f} %",
            "chambers": f"places off by up to {1e3 * errors.chamber_place:g} mm, sizes by up to "
            f"{1e3 * errors.chamber_size:g} mm",
            "cables and points": f"guides off by up to {1e3 * errors.guide:g} mm, points by up to "
            f"{1e3 * errors.point:g} mm",
            "mesh": f"of its own, {len(self.made.mesh.mesh.nodes)} nodes",
            "contact": f"through a skin of {1e9 * errors.skin:g} mm/MPa of its own",
            "sensors": "zeros, gains, drift and noise of their own",
        }


def virtual_robot(drawn: RobotSettings, errors: MakingErrors = MakingErrors()) -> VirtualRobot:
    """Make the robot.

    Raises ConfigError for parts that do not go together or an unknown silicone, MeshError for such errors.
    """
    rng = np.random.default_rng(errors.seed)
    settings = _made(drawn, errors, rng)
    mesh = build_mesh(settings)
    if errors.nodes > 0 and settings.body.source.edges:
        settings, mesh = _finer(settings, mesh, errors.nodes)
    settings = _moved(settings, mesh, errors, rng)
    made = build_robot(settings, mesh)
    contacts = tuple(contact.recut(_RIMS, _SECTORS) for contact in made.model.contacts)
    return VirtualRobot(
        drawn, errors, replace(made, model=eqx.tree_at(lambda m: m.contacts, made.model, contacts))
    )


def _made(drawn: RobotSettings, errors: MakingErrors, rng: np.random.Generator) -> RobotSettings:
    """The settings with other chambers, materials and contacts."""
    chambers = []
    for chamber in drawn.chambers:
        shift, growth = (_uniform(rng, bound) for bound in (errors.chamber_place, errors.chamber_size))
        update = {"shift": _plus(chamber.shift, shift), "growth": _plus(chamber.growth, growth)}
        chambers.append(chamber.model_copy(update=update))
    factor = 1.0 + rng.uniform(-errors.stiffness, errors.stiffness)
    materials = tuple(_stiffening(material, factor, errors.silicone) for material in drawn.body.materials)
    return drawn.model_copy(
        update={
            "chambers": tuple(chambers),
            "body": drawn.body.model_copy(update={"materials": materials}),
            "contacts": tuple(contact.real(errors.skin) for contact in drawn.contacts),
        }
    )


def _stiffening(material: Material, factor: float, name: str | None) -> YeohSettings:
    """So many times as stiff at small strains, and stiffening as a silicone."""
    shear, lame = factor * material.shear_modulus, factor * material.lame
    if name is None:
        name = min(SILICONES, key=lambda each: abs(np.log(2.0 * SILICONES[each].yeoh[0] / shear)))
    law = silicone_of_stiffness(name, shear, 0.5 * lame / (lame + shear))
    bulk = lame + 2.0 * shear / 3.0
    c1, c2, c3 = (float(each) for each in (law.c1, law.c2, law.c3))
    return YeohSettings.model_construct(law="yeoh", c1=c1, c2=c2, c3=c3, bulk=bulk, density=material.density)


def _finer(settings: RobotSettings, mesh: RobotMesh, times: float) -> tuple[RobotSettings, RobotMesh]:
    """The settings, and their mesh, of one that has so many times the nodes of a mesh."""
    shorter = times ** (1.0 / 3.0)
    for _ in range(_MOST_MESHES):
        made = settings.finer(shorter)
        found = build_mesh(made)
        if len(found.mesh.nodes) >= times * len(mesh.mesh.nodes):
            return made, found
        shorter *= _FINER
    raise ConfigError(
        f"{settings.path}: body.source: no mesh with edges {shorter:.2g} times shorter has {times:g} times "
        f"the {len(mesh.mesh.nodes)} nodes: give shorter edges"
    )


def _moved(
    settings: RobotSettings, mesh: RobotMesh, errors: MakingErrors, rng: np.random.Generator
) -> RobotSettings:
    """The settings with guides and points off their places, as far as these stay in the body."""
    cables = []
    for cable in settings.cables:
        guides = _shifted(cable.guides, errors.guide, mesh, rng)
        radius = cable.anchor_radius + rng.uniform(-1.0, 1.0) * min(
            errors.anchor_radius, cable.anchor_radius / 2
        )
        cables.append(cable.model_copy(update={"guides": guides, "anchor_radius": radius}))
    at = _shifted([point.at for point in settings.points], errors.point, mesh, rng)
    points = tuple(
        point.model_copy(update={"at": moved}) for point, moved in zip(settings.points, at, strict=True)
    )
    return settings.model_copy(update={"cables": tuple(cables), "points": points})


def _shifted(
    points: Sequence[Vector], bound: float, mesh: RobotMesh, rng: np.random.Generator
) -> tuple[Vector, ...]:
    if not points:
        return ()
    drawn = np.array(points)
    error = rng.uniform(-bound, bound, drawn.shape)
    moved = drawn.copy()
    for part in reversed(_NEARER):
        further = drawn + part * error
        inside = _inside(mesh, further)[:, None]
        moved = np.where(inside, further, moved)
    return tuple(map(tuple, moved.tolist()))


def _inside(mesh: RobotMesh, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which points (n, 3) m are in the material."""
    nodes = mesh.mesh.nodes
    turns = winding_number(points, nodes, outer_surface(mesh.mesh).faces[:, :3])
    for chamber in mesh.cavities:
        turns = turns - winding_number(points, nodes, chamber.faces[:, :3])
    return turns > 0.5


def _uniform(rng: np.random.Generator, bound: float) -> Float[np.ndarray, "3"]:
    return rng.uniform(-bound, bound, 3)


def _plus(vector: Vector, error: Float[np.ndarray, "3"]) -> Vector:
    x, y, z = (np.array(vector) + error).tolist()
    return x, y, z
