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


class ContactSurface(eqx.Module):
    """Faces (f, 3) or (f, 6) that can be pressed along the unit vector `direction` (3,), and unit tangents
    (2, 3) across it.
    """

    faces: Int[Array, "f s"]
    direction: Float[Array, "3"]
    tangents: Float[Array, "2 3"]

    @classmethod
    def facing(
        cls, faces: Int[np.ndarray, "f s"], rest: Float[np.ndarray, "k 3"], direction: Float[np.ndarray, "3"]
    ) -> "ContactSurface":
        """Those of the outward faces (f, s) of nodes at `rest` (k, 3) m that look against the pressing
        direction (3,).
        """
        d = np.asarray(direction, float) / np.linalg.norm(direction)
        first = np.eye(3)[np.argmin(np.abs(d))]
        first = first - d * (first @ d)
        first /= np.linalg.norm(first)
        corner = np.asarray(rest)[np.asarray(faces)[:, :3]]
        normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        cosine = normal @ d / np.linalg.norm(normal, axis=1)
        tangents = np.stack([first, np.cross(d, first)])
        return cls(jnp.asarray(faces[cosine < -0.1]), jnp.asarray(d), jnp.asarray(tangents))

    def land(
        self, rest: Float[Array, "k 3"], points: Float[Array, "p 3"]
    ) -> tuple[Int[Array, "p s"], Float[Array, "p s"], Bool[Array, " p"]]:
        """Nodes (p, s) and shape values (p, s) where points (p, 3) m meet the surface along the direction,
        and whether they do.
        """
        corners = rest[self.faces[:, :3]]
        flat = corners @ self.tangents.T
        target = points @ self.tangents.T
        everywhere = jax.lax.stop_gradient(_barycentric(target[:, None], flat[None]))
        inside = jnp.min(everywhere, axis=-1) >= -1e-9
        # Of several faces in line the one that the disc meets first.
        height = jax.lax.stop_gradient(jnp.mean(corners @ self.direction, axis=1))
        face = jnp.argmin(jnp.where(inside, height, jnp.inf), axis=1)
        here = _barycentric(target, flat[face])
        shape = linear(here) if self.faces.shape[1] == 3 else quadratic(here)
        return self.faces[face], shape, jnp.any(inside, axis=1)


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

    def _points(self) -> Float[Array, "p 3"]:
        return self.location + self.radius * (self.cells.points @ self.surface.tangents)

    def rows(self, body: Body) -> Float[Array, "n m"]:
        """∂g_k/∂z (n, m) [-]: nodal forces per newton in cell k; its transpose times z gives the
        displacements g (m,) [m].
        """
        nodes, shape, met = self.surface.land(body.rest, self._points())
        share = jnp.where(met[:, None], self.cells.shares, 0.0)
        force = shape[:, :, None, None] * self.surface.direction[:, None] * share[:, None, None, :]
        index = body.displacement_index[nodes]
        return jnp.zeros((body.n, self.cells.count)).at[index].add(force, mode="drop")

    def overlap(self, body: Body) -> Float[Array, ""]:
        """Fraction of the disc's quadrature points that lie on the surface [-]: 1 unless it overhangs an
        edge.
        """
        return jnp.mean(self.surface.land(body.rest, self._points())[2], dtype=float)
