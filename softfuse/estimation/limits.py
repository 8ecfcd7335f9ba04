"""What an estimate may be: bounds of drives and of what answers them."""

from typing import NamedTuple

from jaxtyping import Array, Float


class Limits(NamedTuple):
    """Bounds of D drives, and how a step is damped.

    `lower`, `upper` (D,): of the drives u, equal where a drive is known; `regularisation` ε (D,) [1/drive²];
    `strokes`: lower and upper (D,) of what answers the drives (`AbstractLoad.conjugate`), equal for a hard
    equality such as a cable that is known to be 10 mm shorter, infinite for none; None where there is none at
    all; `motion` [m]: the whole step is shortened so that the drives move no node further; None for any;
    `place` [m]: standard deviation of where a contact presses around the middle of its place; None: anywhere.
    """

    lower: Float[Array, " D"]
    upper: Float[Array, " D"]
    regularisation: Float[Array, " D"]
    strokes: tuple[Float[Array, " D"], Float[Array, " D"]] | None = None
    motion: Float[Array, ""] | None = None
    place: Float[Array, ""] | None = None
