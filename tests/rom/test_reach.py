"""What a disc anywhere in a cell touches, it touches at one of the places that are tried."""

import jax.numpy as jnp
import numpy as np
from scipy.spatial import Delaunay

from softfuse.functional.contact import Contact, ContactSurface
from softfuse.functional.pressure_cells import flat_punch
from softfuse.rom.cells import Cells, places_over


def _touched(mesh: Delaunay, disc: Contact, places: np.ndarray) -> set[int]:
    """Numbers of the triangles that the disc's points lie on at places (s, 3, 3)."""
    offsets = float(disc.radius) * np.asarray(disc.cells.points) @ np.asarray(disc.surface.tangents)
    return set(np.unique(mesh.find_simplex((places[:, :1] + offsets)[..., :2])).tolist())


def test_no_face_is_touched_elsewhere_that_is_not_at_the_places() -> None:
    cells = Cells.over((-0.02, -0.02), (0.02, 0.02), 5e-3)
    more = 0
    for seed in range(12):
        random = np.random.default_rng(seed)
        lattice = np.stack(np.mgrid[-6:7, -6:7], axis=-1).reshape(-1, 2) * 7e-3
        mesh = Delaunay(lattice + random.uniform(-2e-3, 2e-3, lattice.shape))
        rest = np.pad(mesh.points, ((0, 0), (0, 1)))
        surface = ContactSurface.pressed(mesh.simplices, np.array([0.0, 0.0, -1.0]))
        disc = Contact(surface, flat_punch(), jnp.zeros(3), jnp.asarray(0.01))
        cell = cells[int(random.integers(len(cells)))]
        tried = _touched(mesh, disc, places_over(cell, disc, rest))
        assert _touched(mesh, disc, cell.at(1.1 * random.uniform(-1, 1, (1000, 2)))) <= tried
        more += tried > _touched(mesh, disc, cell.grid(21))
    assert more  # where a grid alone misses some
