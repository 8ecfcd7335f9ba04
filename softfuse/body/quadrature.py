"""Quadrature on the reference tetrahedron and triangle, in barycentric coordinates; weights sum to 1.

Sources: Keast, Comput. Methods Appl. Mech. Eng. 55, 1986 (tetrahedra); Dunavant, Int. J. Numer. Methods Eng.
21, 1985 (triangles).
"""

import numpy as np

_A, _B = (5 + 3 * np.sqrt(5)) / 20, (5 - np.sqrt(5)) / 20

# One point, exact for linear integrands: the gradients of a linear tetrahedron are constant.
TET_1 = (np.full((1, 4), 0.25), np.ones(1))

# Four points, exact for quadratic integrands: products of a quadratic tetrahedron's gradients are quadratic.
TET_4 = (np.full((4, 4), _B) + (_A - _B) * np.eye(4), np.full(4, 0.25))


def _orbit(a: float) -> np.ndarray:
    return np.full((3, 3), a) + (1 - 3 * a) * np.eye(3)


# Six points, exact to degree 4: the volume under a curved quadratic face is of degree 4 in its coordinates.
TRIANGLE_6 = (
    np.concatenate([_orbit(0.445948490915964886318329253883), _orbit(0.091576213509770743459571463402)]),
    np.repeat([0.223381589678011465684327080187, 0.109951743655321867649006253147], 3),
)
