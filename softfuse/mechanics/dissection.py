"""Nested dissection of a mesh: in which order the tangent's unknowns are eliminated, and in which dense
fronts.

The elements are halved again and again by planes; the nodes that two halves share (a separator) are
eliminated after both halves. Eliminating a subdomain's own unknowns couples the unknowns on its border only,
so every elimination is a small dense *front* [[D, U], [Uᵀ, B]] of `pivots` and `border`, and what is left of
it, the Schur complement B − UᵀD⁻¹U, is added into the parent's front. No sparse matrix is ever assembled.
Source of the idea: George, SIAM J. Numer. Anal. 10(2), 1973 (dissection); Duff and Reid, ACM TOMS 9(3), 1983
(multifrontal elimination). Everything here is numpy and runs once a mesh.
"""

from dataclasses import dataclass

import numpy as np

_CUTS = np.linspace(0.35, 0.65, 13)  # where along an axis a subdomain may be halved
_BUCKET_SLACK = 1.5  # fronts whose sizes differ by less than this share one padded batch


@dataclass
class Front:
    """One elimination: `pivots` and `border` are unknowns, `children` other fronts, `elements` those
    assembled here.
    """

    pivots: np.ndarray
    border: np.ndarray
    children: list[int]
    elements: np.ndarray


@dataclass
class Batch:
    """Fronts of one level and alike size, padded to `pivots` (f, s) and `border` (f, t) with the unknown `n`.

    `elements` (e,), `element_front` (e,) and `element_slots` (e, d) place element tangents; `children` holds,
    for each batch that children come from, the child's front (c,), the parent's front (c,) and for every slot
    of the parent the child's border slot it receives (c, s + t), or t_child for none.
    """

    pivots: np.ndarray
    border: np.ndarray
    elements: np.ndarray
    element_front: np.ndarray
    element_slots: np.ndarray
    children: list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]


def _halve(elements, centroids, element_nodes, weight):
    """The two halves and their separator that cost least: few separator unknowns, balanced halves."""
    best_cost, best = np.inf, None
    for axis in range(3):
        order = elements[np.argsort(centroids[elements, axis], kind="stable")]
        for cut in _CUTS:
            k = max(1, int(len(order) * cut))
            side = np.zeros(len(weight), np.int8)
            side[element_nodes[order[:k]]] |= 1
            side[element_nodes[order[k:]]] |= 2
            separator = side == 3
            left, right = weight[side == 1].sum(), weight[side == 2].sum()
            balance = max(left, right) / max(left + right, 1)
            cost = weight[separator].sum() * 2 * balance
            if cost < best_cost:
                best_cost, best = cost, (order[:k], order[k:], np.flatnonzero(separator & (weight > 0)))
    assert best is not None
    return best


def _node_tree(centroids, element_nodes, node_weight, leaf_unknowns):
    """Fronts in terms of nodes, children before parents: list of (own nodes, children, elements)."""
    weight = node_weight.copy()  # set to zero once a node has been given to a front
    tree: list[tuple[np.ndarray, list[int], np.ndarray]] = []
    empty = np.zeros(0, np.int64)

    def visit(elements: np.ndarray) -> int:
        nodes = np.unique(element_nodes[elements])
        nodes = nodes[weight[nodes] > 0]
        if weight[nodes].sum() <= leaf_unknowns or len(elements) < 2:
            weight[nodes] = 0
            tree.append((nodes, [], elements))
        else:
            left, right, separator = _halve(elements, centroids, element_nodes, weight)
            weight[separator] = 0
            children = [visit(left), visit(right)]
            tree.append((separator, children, empty))
        return len(tree) - 1

    visit(np.arange(len(element_nodes)))
    return tree


def _fronts(unknowns_of, owner, element_nodes, centroids, n, n_nodes, leaf_unknowns) -> list[Front]:
    node_of = np.zeros(n + 1, np.int64)
    node_of[unknowns_of.ravel()] = element_nodes[:, owner].ravel()
    node_of = node_of[:n]
    weight = np.bincount(node_of, minlength=n_nodes)
    by_node = np.argsort(node_of, kind="stable")
    start = np.concatenate([[0], np.cumsum(weight)])

    def unknowns(nodes):
        return np.concatenate([by_node[start[k] : start[k + 1]] for k in nodes] or [np.zeros(0, np.int64)])

    tree = _node_tree(centroids, element_nodes, weight, leaf_unknowns)
    rank = np.full(n_nodes, -1)
    for k, (own, _, _) in enumerate(tree):
        rank[own] = k
    fronts, borders = [], []
    for k, (own, children, elements) in enumerate(tree):
        touched = [element_nodes[elements].ravel(), *(borders[c] for c in children)]
        nodes = np.unique(np.concatenate(touched))
        borders.append(nodes[rank[nodes] > k])
        fronts.append(Front(unknowns(own), unknowns(borders[-1]), children, elements))
    return fronts


def _batched(fronts: list[Front]) -> list[list[int]]:
    """Front indices by batch: children's batches come first, sizes within a batch are alike."""
    level = np.zeros(len(fronts), int)
    for k, front in enumerate(fronts):
        level[k] = max((level[c] + 1 for c in front.children), default=0)
    batches: list[list[int]] = []
    for height in range(level.max() + 1):
        members = sorted(
            np.flatnonzero(level == height), key=lambda k: -len(fronts[k].pivots) - len(fronts[k].border)
        )
        largest = (0, 0)
        for k in members:
            size = len(fronts[k].pivots), len(fronts[k].pivots) + len(fronts[k].border)
            if (
                largest[1] > _BUCKET_SLACK * max(size[1], 1)
                or largest[0] > 3.0 * max(size[0], 1)
                or largest == (0, 0)
            ):
                batches.append([])
                largest = size
            largest = max(largest[0], size[0]), largest[1]
            batches[-1].append(int(k))
    return batches


def dissect(
    element_unknowns: np.ndarray,
    owner: np.ndarray,
    element_nodes: np.ndarray,
    nodes: np.ndarray,
    n: int,
    *,
    leaf_unknowns: int = 120,
) -> list[Batch]:
    """Plan the elimination of `n` unknowns that elements couple.

    `element_unknowns` (e, d): the element's unknowns, `n` where constrained; `owner` (d,): the local node
    that each sits on; `element_nodes` (e, a): node indices; `nodes` (k, 3) m: positions that planes cut
    through; `leaf_unknowns`: subdomains of at most so many own unknowns are not halved further. Returns the
    batches of fronts, each batch after those of its children.
    """
    centroids = nodes[element_nodes].mean(axis=1)
    fronts = _fronts(element_unknowns, owner, element_nodes, centroids, n, len(nodes), leaf_unknowns)
    groups = _batched(fronts)
    place = {k: (b, i) for b, group in enumerate(groups) for i, k in enumerate(group)}
    slot = np.empty(n + 1, np.int64)
    batches = []
    for group in groups:
        s = max(len(fronts[k].pivots) for k in group)
        t = max(len(fronts[k].border) for k in group)
        pivots, border = np.full((len(group), s), n), np.full((len(group), t), n)
        elements, element_front, element_slots = [], [], []
        links: dict[int, list[tuple[int, int, np.ndarray]]] = {}
        for i, k in enumerate(group):
            front = fronts[k]
            pivots[i, : len(front.pivots)] = front.pivots
            border[i, : len(front.border)] = front.border
            slot[:] = s + t
            slot[front.pivots] = np.arange(len(front.pivots))
            slot[front.border] = s + np.arange(len(front.border))
            elements.append(front.elements)
            element_front.append(np.full(len(front.elements), i))
            element_slots.append(slot[element_unknowns[front.elements]])
            for child in front.children:
                child_batch, child_index = place[child]
                t_child = batches[child_batch].border.shape[1]
                take = np.full(s + t + 1, t_child)
                take[slot[fronts[child].border]] = np.arange(len(fronts[child].border))
                links.setdefault(child_batch, []).append((child_index, i, take[:-1]))
        batches.append(
            Batch(
                pivots,
                border,
                np.concatenate(elements),
                np.concatenate(element_front),
                np.concatenate(element_slots),
                [
                    (
                        source,
                        np.array([c for c, _, _ in rows]),
                        np.array([p for _, p, _ in rows]),
                        np.stack([m for _, _, m in rows]),
                    )
                    for source, rows in sorted(links.items())
                ],
            )
        )
    return batches
