"""A cavity's volume as what it is on a reduced body: a polynomial of third order in few numbers.

The volume is of third order in the positions of the cavity's nodes, so it is in the modes' amplitudes z. What
modes do to the walls has few directions E: u_wall = E y, y = W z. With the slope g of all modes, exact,

    V(z) − V(0) = gᵀ z + ½ yᵀ Q y + ⅙ T(y, y, y),

so that neither nodes nor faces of the walls are needed any more. Directions that states hardly use are left
out of the second and third order only.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from softfuse.body.base import AbstractBody
from softfuse.functional.base import AbstractFunctional
from softfuse.functional.cavity import Cavity
from softfuse.reduction.reduced_body import ReducedBody

_UNUSED = 2e-3
"""Of the largest: directions of the walls that states use less are left out."""


class ProjectedVolume(AbstractFunctional):
    """See the module: `slope` g (n,) [m³], `directions` W (r, n), `bend` Q/2 (r, r) and `twist` T/6 (r, r r)
    [m³].
    """

    slope: Float[Array, " n"]
    directions: Float[Array, "r n"]
    bend: Float[Array, "r r"]
    twist: Float[Array, "r rr"]

    def change(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, ""]:
        """V(z) − V(0) [m³] at amplitudes z (n,) of the body that it was projected for."""
        del body
        y = self.directions @ z
        curved = self.bend @ y + self.twist @ (y[:, None] * y).ravel()
        return self.slope @ z + curved @ y


def projected_volume(cavity: Cavity, body: ReducedBody, reach: Float[np.ndarray, " n"]) -> ProjectedVolume:
    """The volume of a cavity of a reduced body whose modes go as far as `reach` (n,)."""
    m = body.displacement_modes
    nodes, local = np.unique(np.asarray(cavity.faces), return_inverse=True)
    shapes = np.asarray(body.shapes)[nodes].reshape(-1, m)
    left, size, right = np.linalg.svd(shapes * reach[:m], full_matrices=False)
    used = size > _UNUSED * size[0]
    walls = left[:, used]  # E; y = Wz are the walls' motions along it
    at_rest = body.rest[nodes]
    of_walls = Cavity(jnp.asarray(local.reshape(cavity.faces.shape)))

    def volume(moved: Float[Array, " w"]) -> Float[Array, ""]:
        return of_walls(at_rest + moved.reshape(-1, 3))

    def along(y: Float[Array, " r"]) -> Float[Array, ""]:
        return volume(jnp.asarray(walls) @ y)

    still = jnp.zeros(walls.shape[1])
    slope = jax.jit(jax.grad(volume))(jnp.zeros(len(shapes))) @ shapes
    bend = jax.jit(jax.hessian(along))(still)
    twist = jax.jit(jax.jacfwd(jax.hessian(along)))(still)
    directions = size[used, None] * right[used] / reach[:m]
    rest = body.n - m
    return ProjectedVolume(
        slope=jnp.pad(jnp.asarray(slope), (0, rest)),
        directions=jnp.pad(jnp.asarray(directions), ((0, 0), (0, rest))),
        bend=bend / 2,
        twist=twist.reshape(len(still), -1) / 6,
    )
