"""Volumes of cavities as what they are on a reduced body: a polynomial of third order in few numbers.

The volume is of third order in the positions of the cavity's nodes, so it is in the modes' amplitudes z. What
modes do to the walls has few directions E: u_wall = E y, y = W z. With the slope g of all modes, exact,

    V(z) − V(0) = gᵀ z + ½ yᵀ Q y + ⅙ T(y, y, y),

so that neither nodes nor faces of the walls are needed any more. Directions that states use least are left
out of the second and third order only.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.base import AbstractFunctional
from softfuse.functional.cavity import Cavity
from softfuse.rom.reduced_body import ReducedBody

_DIRECTIONS = 12
"""So many that states use most; on the reference block the first ten of them leave a thousandth out."""


class ProjectedVolumes(AbstractFunctional):
    """Those of c cavities, see the module: V(0) `rest` (c,) [m³], `slope` g (c, n) [m³], `directions` W (c,
    r, n), `bend` Q/2 (c, r, r) and `twist` T/6 (c, r, r r) [m³].
    """

    rest: Float[Array, " c"]
    slope: Float[Array, "c n"]
    directions: Float[Array, "c r n"]
    bend: Float[Array, "c r r"]
    twist: Float[Array, "c r rr"]

    @property
    def count(self):
        """One of each cavity."""
        return self.rest.shape[0]

    def change(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, " c"]:
        """V(z) − V(0) (c,) [m³] at amplitudes z (n,) of the body that they were projected for."""
        del body
        c, r, n = self.directions.shape
        y = (self.directions.reshape(c * r, n) @ z).reshape(c, r)
        squares = (y[:, :, None] * y[:, None]).reshape(c, r * r)
        # Sums written out: a batch of small products would be many small programs.
        curved = jnp.sum(self.bend * y[:, None], axis=2) + jnp.sum(self.twist * squares[:, None], axis=2)
        return self.slope @ z + jnp.sum(curved * y, axis=1)

    def bent(self, weights: Float[Array, " c"], z: Float[Array, " n"]) -> Float[Array, "n n"]:
        """Σ_i w_i ∂²V_i/∂z² (n, n) at amplitudes z (n,), with weights (c,)."""
        c, r, n = self.directions.shape
        y = (self.directions.reshape(c * r, n) @ z).reshape(c, r)
        twist = self.twist.reshape(c, r, r, r)
        second = weights[:, None, None] * (2 * self.bend + 6 * jnp.einsum("cijk,ck->cij", twist, y))
        along = jnp.einsum("cij,cjn->cin", second, self.directions)
        return self.directions.reshape(c * r, n).T @ along.reshape(c * r, n)


def projected_volumes(
    cavities: Sequence[Cavity], body: ReducedBody, reach: Float[np.ndarray, " n"]
) -> ProjectedVolumes:
    """The volumes of cavities of a reduced body whose modes go as far as `reach` (n,)."""
    each = zip(*(_projected(cavity, body, reach) for cavity in cavities), strict=True)
    return ProjectedVolumes(*(jnp.asarray(np.stack(parts)) for parts in each))


def _projected(cavity: Cavity, body: ReducedBody, reach: Float[np.ndarray, " n"]) -> tuple[np.ndarray, ...]:
    """Rest (), slope (n,), directions (r, n), bend (r, r) and twist (r, r r) of one cavity."""
    m = body.displacement_modes
    nodes, local = np.unique(np.asarray(cavity.faces), return_inverse=True)
    held = np.append(np.asarray(body.modes), np.zeros((1, m)), axis=0)
    shapes = held[np.minimum(np.asarray(body.index)[nodes], len(body.modes))].reshape(-1, m)
    left, size, right = np.linalg.svd(shapes * reach[:m], full_matrices=False)
    walls = left[:, :_DIRECTIONS]  # E; y = Wz are the walls' motions along it
    rim = np.searchsorted(nodes, np.asarray(cavity.rim))
    of_walls = Cavity(jnp.asarray(local.reshape(cavity.faces.shape)), jnp.asarray(rim))
    slope, bend, twist = map(np.asarray, _derivatives(of_walls, body.rest[nodes], jnp.asarray(walls)))
    directions = (size[:, None] * right)[:_DIRECTIONS] / reach[:m]
    rest = body.n - m
    return (
        np.asarray(of_walls(body.rest[nodes])),
        np.pad(slope @ shapes, (0, rest)),
        np.pad(directions, ((0, 0), (0, rest))),
        bend / 2,
        twist.reshape(len(bend), -1) / 6,
    )


@jax.jit
def _derivatives(
    cavity: Cavity, rest: Float[Array, "w 3"], walls: Float[Array, "3*w r"]
) -> tuple[Float[Array, " 3*w"], Float[Array, "r r"], Float[Array, "r r r"]]:
    """Of the volume at rest: by each node, then of second and third order along the walls' motions."""

    def volume(moved: Float[Array, " three_w"]) -> Float[Array, ""]:
        return cavity(rest + moved.reshape(-1, 3))

    def along(y: Float[Array, " r"]) -> Float[Array, ""]:
        return volume(walls @ y)

    still = jnp.zeros(walls.shape[1])
    bend = jax.hessian(along)
    return jax.grad(volume)(jnp.zeros(len(walls))), bend(still), jax.jacfwd(bend)(still)
