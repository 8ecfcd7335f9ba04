"""Places of contacts that sensors see in coordinates of a chart, and one of several that see the same."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from softfuse.functional.chart import FlatChart, moved


def chart_place(
    chart: FlatChart, at: Float[Array, "2"], covariance_m2: Float[Array, "2 2"]
) -> tuple[Float[Array, "3 3"], Float[Array, "2 2"]]:
    """The place (3, 3) at coordinates (2,) [m], and their covariance (2, 2) [m²] along its tangents."""
    place = chart.place(at)
    turned = place[1:] @ jax.jacfwd(lambda x: chart.place(x)[0])(at)
    return place, turned @ covariance_m2 @ turned.T


def chart_places(
    chart: FlatChart, at: Float[Array, "c 2"], sigma_m: Float[Array, "c 2"]
) -> tuple[Float[Array, "c 3 3"], Float[Array, "c 2 2"]]:
    """The same of c contacts whose coordinates have standard deviations (c, 2) [m], each for itself."""
    return jax.vmap(lambda x, s: chart_place(chart, x, jnp.diag(s**2)))(at, sigma_m)


def joined_places(
    places: Float[Array, "n c 3 3"], covariance_m2: Float[Array, "n c 2 2"], located: Bool[Array, "n c"]
) -> tuple[Float[Array, "c 3 3"], Float[Array, "c 2 2"]]:
    """What n sensors say of c contacts, each by its precision; where none locates one, what the first says.

    Args: places, covariances along their own tangents [m²], and who locates a contact. The place found lies
    in the tangents of the first that does.
    """
    first = jnp.argmax(located, axis=0)
    contacts = jnp.arange(located.shape[1])
    base, own = places[first, contacts], covariance_m2[first, contacts]
    tangents = base[:, 1:]
    offset = jnp.einsum("cki,nci->nck", tangents, places[:, :, 0] - base[:, 0])
    turn = jnp.einsum("cki,ncli->nckl", tangents, places[:, :, 1:])
    spread = jnp.einsum("nckl,nclm,ncjm->nckj", turn, covariance_m2, turn)
    used = located[..., None, None]
    # A covariance that is not used may be anything, also none.
    precision = jnp.where(used, jnp.linalg.inv(jnp.where(used, spread, jnp.eye(2))), 0.0)
    total = jnp.sum(precision, axis=0)
    known = jnp.any(located, axis=0)
    joined = jnp.linalg.inv(jnp.where(known[:, None, None], total, jnp.eye(2)))
    pull = jnp.einsum("nckl,ncl->ck", precision, jnp.where(located[..., None], offset, 0.0))
    mean = jnp.einsum("ckl,cl->ck", joined, pull)
    place = jnp.where(known[:, None, None], moved(base, mean), places[0])
    return place, jnp.where(known[:, None, None], joined, own)
