"""Makes configs/dome.stl, the body of configs/dome.toml: a half sphere with a chamber under its top.

.venv/bin/python scripts/make_dome.py configs/dome.stl
"""

import sys

from manifold3d import Manifold

from softfuse.mesh.files import write_surface
from softfuse.mesh.overlap import outline
from softfuse.mesh.shell import checked

RADIUS, INNER, FLOOR = 30.0, 22.0, 5.0
"""Outer radius, that of the chamber, and thickness of the floor, mm."""
FACETS = 24, 16
"""Around the outer sphere and the chamber."""


def main(path: str) -> None:
    """Write the surface in mm."""
    above = Manifold.cube([200.0, 200.0, 100.0]).translate([-100.0, -100.0, 0.0])
    body = Manifold.sphere(RADIUS, FACETS[0]) ^ above
    chamber = Manifold.sphere(INNER, FACETS[1]) ^ above.translate([0.0, 0.0, FLOOR])
    write_surface(path, checked(*outline(body - chamber)))


if __name__ == "__main__":
    main(sys.argv[1])
