"""Boxes of a tensor grid cut into six tetrahedra each, ready for tagged bisection.

The box [0, 1]³ falls into the six Kuhn tetrahedra 0, e_i, e_i + e_j, (1, 1, 1), one per order (i, j, k) of
the axes; all share the diagonal from 0 to (1, 1, 1), which is their first refinement edge (tag 3).
Neighbouring boxes are mirror images in their common face (the J₁ triangulation of Todd), so both cut that
face alike and list its nodes in the same order, as bisection asks, and the mesh is symmetric about every grid
plane about which the grid itself is symmetric.

Source: M. J. Todd, "The Computation of Fixed Points and Applications", Springer 1976, Ch. III.
"""

from itertools import permutations

import numpy as np
from jaxtyping import Bool, Float

from softfuse.mesh.bisection import TaggedTets


def kuhn_grid(
    planes: tuple[Float[np.ndarray, " nx"], Float[np.ndarray, " ny"], Float[np.ndarray, " nz"]],
    keep: Bool[np.ndarray, "cx cy cz"],
    odd: tuple[int, int, int],
) -> TaggedTets:
    """Tetrahedra of the kept boxes between the planes (nx,), (ny,), (nz,) in m.

    keep (nx − 1, ny − 1, nz − 1) leaves boxes out, with the nodes that only they use; the diagonals start at
    the planes whose index has the parity `odd` (0 or 1 per axis).
    """
    shape = tuple(len(p) for p in planes)
    nodes = np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1).reshape(-1, 3)
    boxes = np.argwhere(keep)
    start = boxes + (boxes + np.array(odd)) % 2
    step = 1 - 2 * ((boxes + np.array(odd)) % 2)
    tets = []
    for axes in permutations(range(3)):
        corner = start.copy()
        chain = [corner.copy()]
        for axis in axes:
            corner[:, axis] += step[:, axis]
            chain.append(corner.copy())
        tets.append(np.stack([np.ravel_multi_index(tuple(c.T), shape) for c in chain], axis=1))
    tets = np.concatenate(tets)
    used, place = np.unique(tets, return_inverse=True)
    count = len(tets)
    return TaggedTets(
        nodes[used], place.reshape(-1, 4).astype(np.int32), np.full(count, 3), np.zeros(count, np.int32)
    )
