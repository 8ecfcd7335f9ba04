"""A disc pressed onto a body's surface: the displacement under each of its pressure cells.

The disc of radius a stands over the location c, perpendicular to the pressing direction d; each of its
quadrature points is carried along d onto the outermost face it meets, at rest. Cell k has the functional g_k
= Σ_i s_ik d · u(x_i), the mean displacement [m] under it, linear in u; its conjugate is the cell's force [N],
which acts in the direction d. The points move with the disc, not with the mesh: g_k is continuous and
piecewise smooth in the location and needs no mesh that knows the disc. Points beyond the body's edge carry
nothing.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from softfuse.body.body import Body
from softfuse.body.shape import linear, quadratic
from softfuse.functional.pressure_cells import PressureCells

_GRAZING = 0.1  # cosine below which a face is seen edge-on


class Landed(eqx.Module):
    """Where points meet a surface: nodes (p, s) of the face, shape values (p, s), their slopes (p, s, 2)
    [1/m] along the surface's tangents, and whether the point meets it at all (p,).
    """

    nodes: Int[Array, "p s"]
    shape: Float[Array, "p s"]
    slopes: Float[Array, "p s 2"]
    met: Bool[Array, " p"]


class ContactSurface(eqx.Module):
    """Faces (f, 3) or (f, 6) that can be pressed along the unit vector `direction` (3,), and unit tangents
    (2, 3) across it, whose cross product it is.
    """

    faces: Int[Array, "f s"]
    direction: Float[Array, "3"]
    tangents: Float[Array, "2 3"]

    @classmethod
    def pressed(cls, faces: Int[np.ndarray, "f s"], direction: Float[np.ndarray, "3"]) -> "ContactSurface":
        """Outward faces (f, s) pressed along a direction (3,) of any length."""
        d = np.asarray(direction, float) / np.linalg.norm(direction)
        first = np.eye(3)[np.argmin(np.abs(d))]
        first = first - d * (first @ d)
        first /= np.linalg.norm(first)
        tangents = np.stack([first, np.cross(d, first)])
        return cls(jnp.asarray(faces), jnp.asarray(d), jnp.asarray(tangents))

    @classmethod
    def facing(
        cls, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"], direction: Float[np.ndarray, "3"]
    ) -> "ContactSurface":
        """Those of the outward faces (f, s) of nodes at `rest` (k, 3) m that look against the direction (3,):
        the only ones that points can land on, so leaving out the others saves time.
        """
        corner = np.asarray(rest)[np.asarray(faces)[:, :3]]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        d = np.asarray(direction, float) / np.linalg.norm(direction)
        return cls.pressed(faces[normal @ d < -_GRAZING * np.linalg.norm(normal, axis=1)], direction)

    def land(self, rest: Float[Array, "k 3"], points: Float[Array, "p 3"]) -> Landed:
        """Where points (p, 3) m meet the surface of nodes at `rest` (k, 3) m along the direction."""
        corners = rest[self.faces[:, :3]]
        flat, target = corners @ self.tangents.T, points @ self.tangents.T
        still, still_flat, still_target = jax.lax.stop_gradient((corners, flat, target))
        normal = jnp.cross(still[:, 1] - still[:, 0], still[:, 2] - still[:, 0])
        facing = normal @ self.direction < -_GRAZING * jnp.linalg.norm(normal, axis=1)
        # A face seen edge-on has no barycentric coordinates: any other triangle in its place does.
        seen = jnp.where(facing[:, None, None], still_flat, jnp.eye(3, 2))
        everywhere = _barycentric(still_target[:, None], seen[None])
        inside = (jnp.min(everywhere, axis=-1) >= -1e-9) & facing
        # Of several faces in line the one that the disc meets first.
        height = jnp.mean(still @ self.direction, axis=1)
        met = jnp.any(inside, axis=1)
        face = jnp.where(met, jnp.argmin(jnp.where(inside, height, jnp.inf), axis=1), jnp.argmax(facing))
        values = linear if self.faces.shape[1] == 3 else quadratic

        def shape_at(place, triangle):
            return values(_barycentric(place, triangle))

        shape = jax.vmap(shape_at)(target, flat[face])
        slopes = jax.vmap(jax.jacfwd(shape_at))(target, flat[face])
        return Landed(self.faces[face], shape, slopes, met)


def _barycentric(point: Float[Array, "... 2"], triangle: Float[Array, "... 3 2"]) -> Float[Array, "... 3"]:
    edge_1, edge_2 = triangle[..., 1, :] - triangle[..., 0, :], triangle[..., 2, :] - triangle[..., 0, :]
    offset = point - triangle[..., 0, :]

    def area(a, b):
        return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]

    second, third = area(offset, edge_2), area(edge_1, offset)
    return (
        jnp.stack([area(edge_1, edge_2) - second - third, second, third], -1)
        / area(edge_1, edge_2)[..., None]
    )


class Contact(eqx.Module):
    """A disc of `radius` (m) that presses at `location` (3,) m of its centre, with the pressure cells it may
    have.
    """

    surface: ContactSurface
    cells: PressureCells
    location: Float[Array, "3"]
    radius: Float[Array, ""]

    def _landed(self, body: Body) -> Landed:
        points = self.location + self.radius * (self.cells.points @ self.surface.tangents)
        return self.surface.land(body.rest, points)

    def rows(self, body: Body) -> Float[Array, "n m"]:
        """∂g_k/∂z (n, m) [-]: nodal forces per newton in cell k; its transpose times z gives the
        displacements g (m,) [m].
        """
        on = self._landed(body)
        share = jnp.where(on.met[:, None], self.cells.shares, 0.0)
        force = on.shape[:, :, None, None] * self.surface.direction[:, None] * share[:, None, None, :]
        index = body.displacement_index[on.nodes]
        return jnp.zeros((body.n, self.cells.count)).at[index].add(force, mode="drop")

    def frame(self, body: Body) -> tuple[Float[Array, " 9"], Float[Array, "n 9"]]:
        """Mean position x (3,) [m] of the patch and its mean tangents ∂x/∂s_1, ∂x/∂s_2 (3,) [-] at rest, and
        the rows of these nine numbers.

        Means over the points that meet the body; the tangents' cross product is the patch's current normal,
        into the body.
        """
        on = self._landed(body)
        share = jnp.where(on.met, jnp.sum(self.cells.shares, axis=1), 0.0)
        share = share / jnp.sum(share)
        each = share[:, None, None] * jnp.concatenate([on.shape[:, :, None], on.slopes], axis=2)
        rest = jnp.einsum("psk,psi->ki", each, body.rest[on.nodes]).ravel()
        spread = jnp.einsum("psk,ij->psikj", each, jnp.eye(3)).reshape(*each.shape[:2], 3, 9)
        index = body.displacement_index[on.nodes]
        return rest, jnp.zeros((body.n, 9)).at[index].add(spread, mode="drop")

    def overlap(self, body: Body) -> Float[Array, ""]:
        """Fraction of the disc's quadrature points that lie on the surface [-]: 1 unless it overhangs an
        edge.
        """
        return jnp.mean(self._landed(body).met, dtype=float)
