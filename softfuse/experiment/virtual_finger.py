"""A soft finger as it comes out of the mould, unlike any model of it: for recordings of a virtual test bed.

It differs from the drawing in everything that an estimator does not know: Yeoh silicone instead of a fitted
modulus, places and sizes of the cavities, height of the necks, guides of the cable; and its mesh is finer.
The errors are uniform in ± their bound, drawn from `seed`. The gas is sealed in at rest, isothermal. x runs
from the clamped base to the tip, z from the palm to the back, left is +y (see `mesh.finger`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Literal

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from softfuse.body.body import Body
from softfuse.body.element import TAYLOR_HOOD
from softfuse.errors import ConfigError
from softfuse.functional.cavity import Cavity
from softfuse.functional.material_points import MaterialPoints
from softfuse.material.silicones import silicone, silicone_of_stiffness
from softfuse.material.yeoh import Yeoh
from softfuse.mechanics.cable import PulledCable, ShortenedCable
from softfuse.mechanics.gas import SealedGas
from softfuse.mechanics.rigid_cylinder import RigidCylinder
from softfuse.mesh.finger import FingerGeometry, finger_mesh
from softfuse.mesh.morph import reshaped_cavities
from softfuse.mesh.surface import cavities
from softfuse.mesh.tetmesh import TetMesh, quadratic

Side = Literal["palm", "left", "right"]

SIDES: tuple[Side, ...] = ("palm", "left", "right")
"""Faces of a segment with an electrode, in the order of the electrodes."""

_INWARDS = {"palm": (0.0, 0.0, 1.0), "left": (0.0, -1.0, 0.0), "right": (0.0, 1.0, 0.0)}
"""Unit normal of each side at rest, into the finger."""

_ELECTRODE_STEPS = 3
"""Points along each edge of the square that stands for an electrode."""

_NECKS_M = (0.03, 0.06, 0.09)

DRAWING = FingerGeometry(
    size=(0.12, 0.02, 0.02),
    neck_x=_NECKS_M,
    neck_length=0.012,
    neck_height=0.015,
    cavity_size=(0.008, 0.006, 0.01),
    cavity_centres=tuple((x, y, 0.0125) for x in _NECKS_M for y in (0.005, -0.005)),
)
"""The finger of configs/finger.toml."""


@dataclass(frozen=True)
class FingerErrors:
    """Bounds in m of how far the finger is from its drawing, in each direction, and the seed of the draw."""

    cavity_place: float = 0.3e-3
    cavity_size: float = 0.2e-3
    neck_height: float = 0.2e-3
    guide: float = 0.3e-3
    anchor_radius: float = 0.3e-3
    seed: int = 1


@dataclass(frozen=True)
class FingerSettings:
    """The drawing, what it is made of, and how finely it is computed; lengths in m, volumes in m³.

    wall_size, base_size, growth: see `mesh.finger.finger_mesh`. guides (g, 3): first the one next to the
    pulling point pulled_at (3,); the cable ends in a ball of anchor_radius around the last one. dead_volume:
    tube and port of each cavity. shear_modulus [Pa]: of small strains, None for that of the silicone, whose
    constants are otherwise scaled. segment_x: middles of the segments' electrodes, squares of twice
    electrode_half, and of the tips that push there: cylinders of tip_radius across the segment, twice
    electrode_half long, that roll over at most patch_half to each side and meet it at patch_points points
    along x and across. points (p, 3): material points whose places are truth.
    """

    drawing: FingerGeometry = DRAWING
    silicone: str = "dragon skin 30"
    shear_modulus: float | None = None
    poisson: float = 0.495
    wall_size: float = 6e-3
    base_size: float = 9e-3
    growth: float = 2.0
    guides: tuple[tuple[float, float, float], ...] = tuple(
        (1e-3 * x, 0.0, 3e-3) for x in (2, 12, 22, 38, 52, 68, 82, 98, 108, 116)
    )
    pulled_at: tuple[float, float, float] = (-5e-3, 0.0, 3e-3)
    anchor_radius: float = 3e-3
    dead_volume: float = 100e-9
    segment_x: tuple[float, ...] = (0.012, 0.045, 0.075, 0.108)
    electrode_half: float = 6e-3
    tip_radius: float = 5e-3
    patch_half: float = 9e-3
    patch_points: tuple[int, int] = (13, 3)
    points: tuple[tuple[float, float, float], ...] = (
        (0.117, 0.0, 0.010),
        (0.105, 0.0, 0.010),
        (0.090, 0.0, 0.0125),
        (0.075, 0.0, 0.010),
    )
    errors: FingerErrors = FingerErrors()


@dataclass(frozen=True, eq=False)
class Carried:
    """Points that move with the body: shape values (g, a) on its nodes (g, a)."""

    nodes: Int[np.ndarray, "g a"]
    shape: Float[np.ndarray, "g a"]

    @classmethod
    def of(cls, body: Body, points: Float[np.ndarray, "g 3"]) -> "Carried":
        """Points at rest positions (g, 3) m. Raises MeshError for a point outside the body."""
        embedded = MaterialPoints.embedded(body, points)
        return cls(np.asarray(embedded.nodes), np.asarray(embedded.shape(body.rest)))

    def at(self, nodes: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "g 3"]:
        """Their positions (g, 3) m at node positions (k, 3) m."""
        return np.einsum("ga,gai->gi", self.shape, nodes[self.nodes])


@dataclass(frozen=True, eq=False)
class VirtualFinger:
    """The body, its cable and gas, and the points that are watched.

    points: those whose places are truth. electrodes: segment 0 palm, left, right, then segment 1 ..., each as
    electrode_points points in a square.
    """

    settings: FingerSettings
    body: Body
    cable: ShortenedCable
    gas: SealedGas
    points: Carried
    electrodes: Carried
    electrode_points: int


def virtual_finger(settings: FingerSettings) -> VirtualFinger:
    """Make the finger.

    Raises MeshError when errors and drawing do not go together, ConfigError for an unknown silicone.
    """
    rng = np.random.default_rng(settings.errors.seed)
    mesh = quadratic(_mesh(settings, rng))
    centres = settings.drawing.centres()
    walls = tuple(Cavity(jnp.asarray(wall.faces)) for wall in cavities(mesh, centres))
    clamped = mesh.nodes[:, 0] <= 1e-9 * settings.drawing.size[0]
    law = _law(settings)
    body = Body.from_mesh(mesh, (law,), clamped, element=TAYLOR_HOOD)
    drawn = np.array(settings.guides)
    guides = drawn + _uniform(rng, settings.errors.guide, drawn.shape)
    anchor = settings.anchor_radius + float(_uniform(rng, settings.errors.anchor_radius, ()))
    cable = PulledCable.through(body, guides, np.array(settings.pulled_at), anchor_radius=anchor)
    steps = settings.electrode_half * np.linspace(-1.0, 1.0, _ELECTRODE_STEPS)
    square = np.array(list(product(steps, steps)))
    segments = range(len(settings.segment_x))
    electrodes = [_on_side(settings, k, side, square) for k in segments for side in SIDES]
    return VirtualFinger(
        settings=settings,
        body=body,
        cable=ShortenedCable.of(cable, body),
        gas=SealedGas.of(walls, body, jnp.full(len(walls), settings.dead_volume)),
        points=Carried.of(body, np.array(settings.points)),
        electrodes=Carried.of(body, np.concatenate(electrodes)),
        electrode_points=len(square),
    )


def rigid_tip(finger: VirtualFinger, segment: int, side: Side) -> RigidCylinder:
    """A round tip that rests on the middle of a side of a segment of the finger at rest.

    Raises ConfigError when the finger has no such segment, or the tip would meet it at a point or a line.
    """
    settings = finger.settings
    if min(settings.patch_points) < 2:
        raise ConfigError(
            f"a tip that meets the finger at {settings.patch_points} points: give at least (2, 2)"
        )
    count = len(settings.segment_x)
    if not 0 <= segment < count:
        raise ConfigError(f"segment {segment} cannot be pushed: give a number from 0 to {count - 1}")
    along, across = (np.linspace(-1.0, 1.0, n) for n in settings.patch_points)
    patch = np.array(list(product(settings.patch_half * along, settings.electrode_half * across)))
    normal = np.array(_INWARDS[side])
    return RigidCylinder.before(
        finger.body,
        _on_side(settings, segment, side, patch),
        _on_side(settings, segment, side, np.zeros((1, 2)))[0],
        normal,
        np.cross(normal, [1.0, 0.0, 0.0]),
        settings.tip_radius,
    )


def set_against(tip: RigidCylinder, grid: Float[np.ndarray, "n m 3"]) -> tuple[RigidCylinder, float]:
    """The tip set up against its patch where that is now, and the drive [m] of first contact.

    grid (n, m, 3) m: the patch's points, n along and m across it.
    It rests on the patch's middle, lies across it, and will move along its normal.
    """
    patch = grid.reshape(-1, 3)
    middle = patch.mean(axis=0)
    across = grid[:, -1].mean(axis=0) - grid[:, 0].mean(axis=0)
    lengthwise = grid[-1].mean(axis=0) - grid[0].mean(axis=0)
    normal = np.cross(lengthwise, across)
    direction = normal / np.linalg.norm(normal) * np.sign(normal @ np.asarray(tip.direction))
    axis = across / np.linalg.norm(across)
    radius = float(tip.radius)
    centre = middle - radius * direction
    placed = (jnp.asarray(centre), jnp.asarray(axis), jnp.asarray(direction))
    tip = eqx.tree_at(lambda t: (t.centre, t.axis, t.direction), tip, placed)
    ahead, aside = seen_from(tip, centre, patch)
    reached = aside < radius
    return tip, float(np.min(ahead[reached] - np.sqrt(radius**2 - aside[reached] ** 2)))


def seen_from(
    tip: RigidCylinder, centre: Float[np.ndarray, "3"], points: Float[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """How far points (m, 3) m are ahead (m,) of a tip's axis through centre (3,) m, and to its side (m,)."""
    direction, axis = np.asarray(tip.direction), np.asarray(tip.axis)
    away = points - centre
    ahead = away @ direction
    aside = np.linalg.norm(away - np.outer(away @ axis, axis) - np.outer(ahead, direction), axis=1)
    return ahead, aside


def electrode_index(segment: int, side: Side) -> int:
    """Number of the electrode on a side of a segment."""
    return len(SIDES) * segment + SIDES.index(side)


def _on_side(
    settings: FingerSettings, segment: int, side: Side, offsets: Float[np.ndarray, "g 2"]
) -> Float[np.ndarray, "g 3"]:
    """Points (g, 3) m on a side of a segment, at offsets (g, 2) m along x and across from its middle."""
    _, width, height = settings.drawing.size
    normal = np.array(_INWARDS[side])
    middle = np.array([settings.segment_x[segment], 0.0, 0.5 * height])
    face = middle - 0.5 * normal * np.array([0.0, width, height])
    across = np.abs(np.cross(normal, [1.0, 0.0, 0.0]))
    return face + offsets[:, :1] * np.array([1.0, 0.0, 0.0]) + offsets[:, 1:] * across


def _law(settings: FingerSettings) -> Yeoh:
    if settings.shear_modulus is None:
        return silicone(settings.silicone, settings.poisson)
    return silicone_of_stiffness(settings.silicone, settings.shear_modulus, settings.poisson)


def _mesh(settings: FingerSettings, rng: np.random.Generator) -> TetMesh:
    drawing, errors = settings.drawing, settings.errors
    height = drawing.neck_height + float(_uniform(rng, errors.neck_height, ()))
    mesh = finger_mesh(
        replace(drawing, neck_height=height),
        settings.wall_size,
        settings.base_size,
        growth=settings.growth,
    )
    centres = drawing.centres()
    shifts = _uniform(rng, errors.cavity_place, centres.shape)
    growths = _uniform(rng, errors.cavity_size, centres.shape)
    return reshaped_cavities(mesh, shifts, growths, centres=centres)


def _uniform(rng: np.random.Generator, bound: float, shape: Sequence[int]) -> np.ndarray:
    return rng.uniform(-bound, bound, tuple(shape))
