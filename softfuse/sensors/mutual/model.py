"""What things near and on a grid of mutual capacitances do to its readings: shielding and coupling.

A cell is where a column crosses a row, 2b wide. Two effects of opposite sign share its one reading (Navarro
et al., RA-L 5(4), 2020, Sec. V-A.3). In units of `contact_counts`, what a grounded finger takes that lies on
a cell's middle, and with the gain a of each cell,

    u(r) = a Σ_c [k_c K(r − p_c) − s_c S(r − p_c; s_c)],   K(0) = S(0) = 1.

* shielding s: a grounded conductor draws off the field that passes above the surface, so the reading drops.
  Held at 1 V among strips at 0 V, a strip has the potential (Laplace's equation in the half space)
  φ(x, z) = (1/π) [atan((x + b)/z) − atan((x − b)/z)] at the height z above it. What a column and a row
  both see over their crossing falls with φ(0, z)², so s tells the height,

      s = (atan(b/z) / atan(b/t))²,   z = t in contact, t the electrodes' depth,

  and s = 1 is contact: more than that no finger takes. A finger is a disc of radius R that takes
  φ_column(x, z) φ_row(y, z) at each of its points, so S is that product summed over points of the disc.
* coupling k: a force brings the electrodes nearer together (C ~ 1/gap), or a dielectric guides field across,
  so the reading rises, under the thing itself only: K is the part of the disc that lies on the cell, blurred
  over the depth t, ½ [tanh((x + b)/L) − tanh((x − b)/L)] in x and y alike with L = 2√3 t/π, summed over the
  same points.

Both effects are small against the whole capacitance, so they add up. Then crosstalk: each cell shows the part
χ of the signals of the other cells on its column and its row as well. Signals are counts above the baseline
(minus while something grounded hovers), as images (c, r) with the first index along x.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

_FAINTEST = 1e-3  # of contact: below, shielding has no distance to speak of


def _unit_disc() -> Float[np.ndarray, "q 2"]:
    """Points that share the unit disc evenly: two rings of six, turned against each other."""
    radius = np.repeat(np.sqrt([0.25, 0.75]), 6)
    angle = np.concatenate([np.arange(6), np.arange(6) + 0.5]) * np.pi / 3
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


_DISC = _unit_disc()


def mean_pitch(column_x, row_y):
    """Mean distance between neighbours among lines at column_x (c,) and among those at row_y (r,)."""
    x, y = ((line[-1] - line[0]) / (len(line) - 1) for line in (column_x, row_y))
    return 0.5 * (x + y)


class MutualModel(eqx.Module):
    """The grid: x of its columns' centre lines (c,), y of its rows' (r,), ascending, b, t and R [m], a (c,
    r), and χ; and what is assumed about what touches it. All fields are leaves.
    """

    column_x_m: Float[Array, " c"]
    row_y_m: Float[Array, " r"]
    half_width_m: Float[Array, ""]
    depth_m: Float[Array, ""]
    finger_radius_m: Float[Array, ""]
    contact_counts: Float[Array, ""]
    """Drop of a cell's reading under a grounded finger that lies on it without force [counts]."""
    gain: Float[Array, "c r"]
    crosstalk: Float[Array, ""]
    shield_sigma: Float[Array, ""]
    """Standard deviation of the shielding of different fingers in contact, by which s may exceed 1."""
    noise_counts: Float[Array, ""]
    """Standard deviation of one reading [counts]."""
    model_error: Float[Array, ""]
    """Standard deviation of the model's misfit relative to the largest signal, or effect in contact."""
    common_error: Float[Array, ""]
    """Standard deviation of what all baselines are off by alike [contact]."""

    @property
    def pitch_m(self) -> Float[Array, ""]:
        """Mean distance between neighbouring lines [m]."""
        return mean_pitch(self.column_x_m, self.row_y_m)


class Sources(eqx.Module):
    """n things at a grid."""

    place_m: Float[Array, "n 2"]
    """(n, 2) x, y [m]."""
    shield: Float[Array, " n"]
    """(n,) shielding s >= 0; 1 in contact."""
    coupling: Float[Array, " n"]
    """(n,) coupling k >= 0, in the same unit."""


def height_of(model: MutualModel, shield: Float[Array, ""]) -> Float[Array, ""]:
    """Height z above the electrodes [m] at which a finger shields by `shield`; their depth in contact."""
    root = jnp.sqrt(jnp.clip(shield, _FAINTEST, 1.0))
    return model.half_width_m / jnp.tan(root * jnp.arctan(model.half_width_m / model.depth_m))


def shield_shape(
    model: MutualModel, place_m: Float[Array, "2"], shield: Float[Array, ""]
) -> Float[Array, "c r"]:
    """S (c, r) of a thing at place_m (2,) [m] that shields by `shield`."""
    return _over_disc(model, place_m, height_of(model, shield), _potential)


def coupling_shape(model: MutualModel, place_m: Float[Array, "2"]) -> Float[Array, "c r"]:
    """K (c, r) of a thing at place_m (2,) [m]."""
    return _over_disc(model, place_m, model.depth_m, _blurred_box)


def _over_disc(model: MutualModel, place_m, length_m, of_line) -> Float[Array, "c r"]:
    """Sum over the disc of what column and row have of each point, relative to that on a cell's middle."""
    points = model.finger_radius_m * jnp.asarray(_DISC)
    column, row, *middle = (
        of_line(apart, model.half_width_m, length_m)
        for apart in (
            model.column_x_m[:, None] - place_m[0] - points[:, 0],
            model.row_y_m[:, None] - place_m[1] - points[:, 1],
            points[:, 0],
            points[:, 1],
        )
    )
    return column @ row.T / (middle[0] @ middle[1])


def _potential(apart_m, half_width_m, height_m):
    """φ of a strip, elementwise."""
    high, low = (apart_m + half_width_m) / height_m, (apart_m - half_width_m) / height_m
    return (jnp.arctan(high) - jnp.arctan(low)) / jnp.pi


def _blurred_box(apart_m, half_width_m, blur_m):
    """B, elementwise."""
    length = blur_m * (2 * np.sqrt(3.0) / np.pi)
    return 0.5 * (jnp.tanh((apart_m + half_width_m) / length) - jnp.tanh((apart_m - half_width_m) / length))


def one_signal(
    model: MutualModel, place_m: Float[Array, "2"], shield: Float[Array, ""], coupling: Float[Array, ""]
) -> Float[Array, " e"]:
    """Signal (c r,) [counts] of one thing at place_m (2,) [m] that shields and couples."""
    change = coupling * coupling_shape(model, place_m) - shield * shield_shape(model, place_m, shield)
    return (model.contact_counts * model.gain * _with_crosstalk(model, change)).ravel()


def _with_crosstalk(model: MutualModel, change: Float[Array, "c r"]) -> Float[Array, "c r"]:
    """What the cells show of their own change and of that of the others along both their lines."""
    along_both = jnp.sum(change, axis=0, keepdims=True) + jnp.sum(change, axis=1, keepdims=True)
    return change + model.crosstalk * (along_both - 2.0 * change)


def source_signals(model: MutualModel, sources: Sources) -> Float[Array, "n e"]:
    """Signal of each source at all cells (n, c r) [counts]."""
    return jax.vmap(one_signal, (None, 0, 0, 0))(model, sources.place_m, sources.shield, sources.coupling)
