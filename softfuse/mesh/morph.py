"""Cavities shifted and resized inside a body, the mesh following smoothly.

Each component of the nodes' displacement d is harmonic, ∇²d = 0, with d = 0 on the skin of the body and d
given on the walls of the cavities: d = s + g (X − X_m)/L for a shift s and a growth g of a cavity that has
the bounding box of middle X_m and size L (by component), solved with linear elements: Σ V ∇N_a · ∇N_b d_b
= 0. It is linear in s and g, through four fields of each cavity. The topology stays, hence so do the numbers
of nodes and tetrahedra, and quantities before and after can be compared one by one.

Of a quadratic mesh, nodes in the middle of edges are given d too where they lie on walls, and the mean of
their ends elsewhere: curved walls keep their shape, a quadric stays one. Where that would press a tetrahedron
flat, as between walls that come close, its edges become straighter.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from softfuse.errors import MeshError
from softfuse.mesh.conforming import KEPT, moved_within
from softfuse.mesh.orientation import check
from softfuse.mesh.quality import curved_mean_ratios, mean_ratios
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.mesh.tetmesh import EDGES, TetMesh, linear, volumes


def moved_cavities(
    mesh: TetMesh, shifts: Float[np.ndarray, "k 3"], *, centres: Float[np.ndarray, "k 3"] | None = None
) -> TetMesh:
    """The mesh with cavity k shifted by shifts[k] (k, 3) m and the skin in place.

    centres (k, 3) m tell which cavity is which, see `cavities`. Raises MeshError when a shift turns a
    tetrahedron over or the number of shifts is not that of the cavities.
    """
    return reshaped_cavities(mesh, shifts, np.zeros_like(shifts), centres=centres)


def reshaped_cavities(
    mesh: TetMesh,
    shifts: Float[np.ndarray, "k 3"],
    growths: Float[np.ndarray, "k 3"],
    *,
    centres: Float[np.ndarray, "k 3"] | None = None,
) -> TetMesh:
    """The mesh with cavity k shifted by shifts[k] and longer by growths[k] (k, 3) m along x, y, z, the skin
    in place.

    centres (k, 3) m and errors raised: see `moved_cavities`.
    """
    fields = wall_fields(mesh, centres=centres)
    for given, what in ((shifts, "shifts"), (growths, "growths")):
        if len(given) != len(fields):
            raise MeshError(f"{len(given)} {what} are given for {len(fields)} cavities: give one for each")
    displacement = np.einsum("ki,kn->ni", shifts, fields[:, 0]) + np.einsum(
        "ki,kin->ni", growths, fields[:, 1:]
    )
    moved = replace(mesh, nodes=mesh.nodes + displacement)
    try:
        check(linear(moved))
        if mesh.order == 2:
            moved = _curved(mesh, moved)
            check(moved)
    except MeshError as error:
        raise MeshError(
            f"the cavities are shifted too far or grown too much ({error}): mesh the new layout"
        ) from error
    return moved


def _curved(mesh: TetMesh, moved: TetMesh) -> TetMesh:
    """The moved mesh with its edges curved as far as tetrahedra keep a part of the shape that they had."""
    nodes = moved.nodes.copy()
    nodes[mesh.tets[:, 4:]] = nodes[mesh.tets[:, EDGES]].mean(axis=2)
    straight = replace(moved, nodes=nodes)
    least = KEPT * np.minimum(mean_ratios(straight), curved_mean_ratios(mesh))
    return moved_within(straight, moved.nodes - nodes, least)


def wall_fields(
    mesh: TetMesh, *, centres: Float[np.ndarray, "k 3"] | None = None
) -> Float[np.ndarray, "k 4 n"]:
    """Harmonic fields (k, 4, n) [-] at the nodes, 0 on the skin and on the walls of other cavities: on those
    of cavity k first 1, what a shift by 1 m moves along its axis; then (X − X_m)/L along x, y and z, what a
    growth by 1 m moves along the same axis.

    centres (k, 3) m tell which cavity is which, see `cavities`.
    """
    walls = cavities(mesh, centres)
    fields = np.zeros((len(walls), 4, len(mesh.nodes)))
    if not walls:
        return fields
    for wall, field in zip(walls, fields, strict=True):
        nodes = np.unique(wall.faces)
        x = mesh.nodes[nodes]
        low, high = x.min(axis=0), x.max(axis=0)
        field[0, nodes] = 1.0
        field[1:, nodes] = ((x - 0.5 * (low + high)) / (high - low)).T
    boundary = [part.faces for part in (outer_surface(mesh), *walls)]
    held = np.unique(np.concatenate([faces[:, :3] for faces in boundary]))
    given = fields[..., held].reshape(4 * len(walls), -1).T
    corners = harmonic_extension(linear(mesh), held, given).T
    fields[..., : mesh.n_corners] = corners.reshape(len(walls), 4, -1)
    if mesh.order == 2:
        inner = ~np.isin(mesh.tets[:, 4:], np.concatenate(boundary))
        ends = mesh.tets[:, EDGES][inner]
        fields[..., mesh.tets[:, 4:][inner]] = fields[..., ends].mean(axis=-1)
    return fields


def harmonic_extension(
    mesh: TetMesh,
    held: Int[np.ndarray, " h"],
    given: Float[np.ndarray, "h c"],
) -> Float[np.ndarray, "n c"]:
    """Fields (n, c) at the nodes of a linear mesh that are given (h, c) at the nodes held (h,), in any unit,
    and harmonic between them. With the columns of a unit matrix given, it is the operator from what is held
    to everything.
    """
    fields = np.zeros((len(mesh.nodes), given.shape[1]))
    fields[held] = given
    free = np.ones(len(mesh.nodes), bool)
    free[held] = False
    if free.any():
        stiffness = _laplacian(mesh)
        load = -(stiffness[free][:, held] @ given)
        fields[free] = splu(stiffness[free][:, free].tocsc()).solve(load)
    return fields


def _laplacian(mesh: TetMesh) -> csr_array:
    """Matrix (n, n) in m of the Dirichlet energy with linear elements."""
    corners = mesh.nodes[mesh.tets]
    inverse = np.linalg.inv(corners[:, 1:] - corners[:, :1])
    slopes = np.concatenate([-inverse.sum(axis=2, keepdims=True), inverse], axis=2)
    blocks = np.einsum("m,mia,mib->mab", volumes(mesh), slopes, slopes)
    rows, columns = np.repeat(mesh.tets, 4, axis=1), np.tile(mesh.tets, (1, 4))
    count = len(mesh.nodes)
    return csr_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(count, count))
