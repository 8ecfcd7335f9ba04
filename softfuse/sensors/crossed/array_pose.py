"""Where an electrode array lies on the body: it is glued on, cast in, and stretches with the skin.

A contact that the array places at l, in the coordinates it is drawn in, is on the body at

    x = c + R(α) D l,

with a shift c, a turn α about the direction that the array is seen from, and a stretch D = diag(d_x, d_y).
Its covariance is turned and stretched alike, and times the square of a factor: how much wider locations
spread than the fit of a peak promises, unless its misfit says more. The fit takes the array for flat: a dent
tilts what lies around it, and locations spread by a part of its depth besides.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float


class ArrayPose(eqx.Module):
    """Shift c (2,) [m], turn α [rad], stretch d (2,) [-], the factor on standard deviations [-], and the
    part of a dent's depth by which locations spread besides [-]; all fields are leaves.
    """

    shift_m: Float[Array, "2"]
    turn: Float[Array, ""]
    stretch: Float[Array, "2"]
    sigma_factor: Float[Array, ""]
    dent_part: Float[Array, ""]

    def on_body(self, location_m: Float[Array, "2"]) -> Float[Array, "2"]:
        """Where on the body (2,) m a place in the array's coordinates (2,) m is."""
        return self.shift_m + self._turned @ location_m

    def on_array(self, place_m: Float[Array, "2"]) -> Float[Array, "2"]:
        """Where in the array's coordinates (2,) m a place on the body (2,) m is."""
        return jnp.linalg.solve(self._turned, place_m - self.shift_m)

    def spread(
        self, covariance_m2: Float[Array, "2 2"], widening: Float[Array, ""], dent_m: Float[Array, ""]
    ) -> Float[Array, "2 2"]:
        """Covariance (2, 2) m² on the body of a location.

        Args: covariance_m2 (2, 2) in the array's coordinates [m²], which a misfit has made larger by
        widening >= 1 [-]; dent_m, depth of the dent [m]. Factor and dent are what made presses spread wider
        than promised without the widening, so that the larger of both counts.
        """
        misfit = self._turned @ covariance_m2 @ self._turned.T
        spread = self.sigma_factor**2 * misfit / widening + (self.dent_part * dent_m) ** 2 * jnp.eye(2)
        return jnp.where(jnp.trace(misfit) > jnp.trace(spread), misfit, spread)

    @property
    def _turned(self) -> Float[Array, "2 2"]:
        c, s = jnp.cos(self.turn), jnp.sin(self.turn)
        return jnp.array([[c, -s], [s, c]]) * self.stretch
