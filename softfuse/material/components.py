"""Second-order tensors as nine separate arrays, one for each component: t[i][j] (...) is T_ij at every point.

A loop over points then reads and writes whole arrays. With the components along an axis of one array, XLA
computes anew for each component all that it depends on. Source of the products: Bonet, Gil and Wood, Comput.
Methods Appl. Mech. Eng. 283 (2015) 1061.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

Row = tuple[Float[Array, "..."], Float[Array, "..."], Float[Array, "..."]]
Tensor = tuple[Row, Row, Row]

_AXES = (0, 1, 2)


def components(t: Float[Array, "3 3 *points"]) -> Tensor:
    """The components (...) of tensors (3, 3, ...)."""
    (a, b, c), (d, e, f), (g, h, i) = ((t[k, 0], t[k, 1], t[k, 2]) for k in _AXES)
    return (a, b, c), (d, e, f), (g, h, i)


def whole(t: Tensor) -> Float[Array, "3 3 *points"]:
    """One array (3, 3, ...) of the components (...)."""
    return jnp.stack([jnp.stack(row) for row in t])


def contraction(s: Tensor, t: Tensor) -> Float[Array, "..."]:
    """S : T = Σ_ij S_ij T_ij (...)."""
    first, *others = (s[i][j] * t[i][j] for i in _AXES for j in _AXES)
    return sum(others, start=first)


def cofactor(t: Tensor) -> Tensor:
    """cof T = det T · T⁻ᵀ = ½ T ⨯ T."""
    return _each(lambda p, q, r, s: t[p][q] * t[r][s] - t[p][s] * t[r][q])


def cross(s: Tensor, t: Tensor) -> Tensor:
    """S ⨯ T, (S ⨯ T)_ij = ε_ikl ε_jmn S_km T_ln: the derivative of cof T along S."""
    return _each(
        lambda k, m, p, n: s[k][m] * t[p][n] - s[k][n] * t[p][m] + t[k][m] * s[p][n] - t[k][n] * s[p][m]
    )


def determinant(t: Tensor) -> Float[Array, "..."]:
    """det T (...), a polynomial: so are its derivatives of any order."""
    (a, b, c), (d, e, f), (g, h, i) = t
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def _each(entry: Callable[[int, int, int, int], Float[Array, "..."]]) -> Tensor:
    """Entries ij from those of the rows and columns after i and j: entry(i + 1, j + 1, i + 2, j + 2).

    Taken cyclically, they make a cofactor's signs come out by themselves.
    """

    def row(i: int) -> Row:
        k, p = (i + 1) % 3, (i + 2) % 3
        return entry(k, 1, p, 2), entry(k, 2, p, 0), entry(k, 0, p, 1)

    return row(0), row(1), row(2)
