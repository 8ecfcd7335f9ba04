"""The soft finger: a beam with thinner necks that hold closed box-shaped cavities.

x runs from the clamped base (0) to the tip (size[0]), y across (centred; + is left, seen from the base with
the back up), z from the palm (0) to the back (size[2]). A neck is what a notch of the full width leaves of
the beam at its back: a cable along the palm runs free through the notch.

How much a cavity's volume changes depends most on the stress around its edges, where it is singular. So the
mesh (see `block`) has no edge longer than

    h = wall_size + growth · d

with d the distance of the tetrahedron's nearest corner from the edges of the cavities. The mesh has the
mirror symmetry of the finger in y = 0 and starts, where the necks are alike and evenly spaced, from the same
grid around each of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge
from jaxtyping import Float

from softfuse.errors import MeshError
from softfuse.io.quantity import Number, PositiveLength
from softfuse.io.settings import NotEmpty, Vector
from softfuse.mesh.block import Block, Fineness, block_mesh, centred_boxes, finer_to_edges
from softfuse.mesh.body_source import BodySource, Size
from softfuse.mesh.shell import Shell
from softfuse.mesh.tetmesh import TetMesh

_SAME = 1e-9
"""Length over the finger's own below which nothing is left between two necks or between a neck and an end."""


@dataclass(frozen=True)
class FingerGeometry:
    """Beam size (3,) m; middles (n,) m along x, length and height in m of its necks; cavities.

    A neck reaches from the back down to neck_height below it; with the height of the finger there is no
    notch. The cavities have the size (3,) m and the centres (k, 3) m.
    """

    size: tuple[float, float, float]
    neck_x: tuple[float, ...]
    neck_length: float
    neck_height: float
    cavity_size: tuple[float, float, float]
    cavity_centres: tuple[tuple[float, float, float], ...]

    def centres(self) -> Float[np.ndarray, "k 3"]:
        """Centres (k, 3) in m of the cavities, in the order of the config."""
        return np.array(self.cavity_centres, float).reshape(-1, 3)

    def notches(self) -> Float[np.ndarray, "n 2 3"]:
        """Lowest and highest corners (n, 2, 3) in m of the notches; n = 0 when the necks are as high as the
        finger.
        """
        depth = self.size[2] - self.neck_height
        if depth <= _SAME * self.size[2]:
            return np.empty((0, 2, 3))
        centres = np.array([(x, 0.0, 0.5 * depth) for x in self.neck_x])
        return centred_boxes(centres, (self.neck_length, self.size[1], depth))

    def block(self) -> Block:
        """The beam with its cavities and notches, planes of the grid in the middle of all that is alike."""
        x, y, z = self.size
        necks = np.sort(self.neck_x)
        middles = 0.5 * (necks[1:] + necks[:-1])
        return Block(
            low=np.array([0.0, -0.5 * y, 0.0]),
            high=np.array([x, 0.5 * y, z]),
            cavities=centred_boxes(self.centres(), self.cavity_size),
            notches=self.notches(),
            planes=((*necks.tolist(), *middles.tolist()), (0.0,), (z,)),
        )


class FingerSource(BodySource):
    """A beam with necks and equal box-shaped cavities.

    x from the clamped base (0) to the tip, y centred, z from the palm (0) to the back. size, cavity_size:
    (3,) m; neck_x: middles (n,) m of the necks along x; a neck is neck_length m long and reaches from the
    back down to neck_height m below it. The cavities stand where [[chamber]] says. Lengths of the mesh's
    edges: at most wall_size m around the cavities, growing by growth m per m from there; the grid under it
    has boxes of at most base_size m.
    """

    edges: ClassVar[tuple[str, ...]] = ("wall_size", "base_size")

    type: Literal["finger"]
    size: Size
    neck_x: Annotated[tuple[PositiveLength, ...], NotEmpty]
    neck_length: PositiveLength
    neck_height: PositiveLength
    cavity_size: Size
    wall_size: PositiveLength
    base_size: PositiveLength
    growth: Annotated[Number, Ge(0)] = 2.0

    def geometry(self, cavity_centres: Sequence[Vector]) -> FingerGeometry:
        """The finger with cavities at the centres (k, 3) m."""
        return FingerGeometry(
            size=self.size,
            neck_x=self.neck_x,
            neck_length=self.neck_length,
            neck_height=self.neck_height,
            cavity_size=self.cavity_size,
            cavity_centres=tuple(cavity_centres),
        )

    def mesh(self, cavity_centres: Sequence[Vector], chambers: Sequence[Shell] = ()) -> TetMesh:
        """The same, meshed; see `finger_mesh` for the errors."""
        geometry = self.geometry(cavity_centres)
        return finger_mesh(geometry, self.wall_size, self.base_size, growth=self.growth)

    def outside(self) -> Block:
        """The beam with its notches."""
        return self.geometry(()).block()

    def fineness(self, boxes: Float[np.ndarray, "k 2 3"]) -> Fineness:
        """Finer to the edges of the boxes."""
        farthest = float(np.linalg.norm(self.size))
        longest = finer_to_edges(boxes, farthest, self.wall_size, growth=self.growth)
        return Fineness(self.base_size, longest)


def finger_mesh(
    geometry: FingerGeometry, wall_size: float, base_size: float, *, growth: float = 2.0
) -> TetMesh:
    """Linear tetrahedra of the finger, edges around the cavities at most wall_size m long.

    The tetrahedra come from grid boxes of at most base_size m; their longest edge gains growth metres per
    metre of distance from the cavities' edges; for another fineness see `block_mesh`. Raises MeshError when a
    length is not positive, necks meet or reach an end, a cavity reaches the surface, a notch or another
    cavity, or faces lie too near to each other.
    """
    cavities = centred_boxes(geometry.centres(), geometry.cavity_size)
    farthest = float(np.linalg.norm(geometry.size))
    longest = finer_to_edges(cavities, farthest, wall_size, growth=growth)
    _check(geometry)
    return block_mesh(geometry.block(), base_size, longest)


def _check(geometry: FingerGeometry) -> None:
    lengths = (*geometry.size, *geometry.cavity_size, geometry.neck_length, geometry.neck_height)
    if min(lengths) <= 0.0:
        raise MeshError("size, cavity_size, neck_length and neck_height must be positive")
    length, height = geometry.size[0], geometry.size[2]
    if geometry.neck_height > height * (1.0 + _SAME):
        raise MeshError(
            f"the necks are {1e3 * geometry.neck_height:.4g} mm high, the finger {1e3 * height:.4g} mm: "
            "lower neck_height; the height of the finger leaves no notch"
        )
    if not geometry.neck_x:
        raise MeshError("the finger has no neck: give the middle of at least one in neck_x")
    gap = _SAME * length
    for k, x in enumerate(geometry.neck_x):
        if min(x, length - x) <= 0.5 * geometry.neck_length + gap:
            raise MeshError(
                f"neck {k} at x = {1e3 * x:.4g} mm reaches an end of the finger: shorten or move it"
            )
        for j in range(k):
            if abs(x - geometry.neck_x[j]) <= geometry.neck_length + gap:
                raise MeshError(f"necks {j} and {k} leave no segment between them: shorten or move them")
