"""Whether a designed body's surface that was written for casting has the sensitivities that were designed.

    .venv/bin/python benchmarks/reimported_body.py PLAN DIR [--edge MM] [--envelope PART] [--every N]

PLAN is a design task and DIR the folder of its run (`softfuse design PLAN --out DIR`). DIR/casting/body.stl
is filled with tetrahedra of edges of so many mm (8) by fTetWild, which knows nothing of the layout and stays
within so large a part of its diagonal (0.0025) of the surface before its nodes are brought onto that. The
body is pressed at each Nth (5) of the plan's places, as is the robot of DIR/designed.toml on its own mesh
and on that mesh refined. Printed: volumes of the cavities, the norm of the readings per newton, mean and
coefficient of variation, and by how much the norms, and the readings of single cavities, of the first differ
from the others', in parts of the mean norm.
"""

import argparse
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from softfuse.computing.prepare import prepare_jax
from softfuse.design.of_robot import build_places
from softfuse.design.plan import DesignPlan, load_design
from softfuse.estimation.rest_response import rest_response
from softfuse.functional.cavity import Cavity
from softfuse.mesh.file_source import SurfaceSource
from softfuse.mesh.orientation import oriented
from softfuse.mesh.subdivision import refined
from softfuse.mesh.surface import cavities, centroid
from softfuse.robot.file import load
from softfuse.robot.mesh import RobotMesh, build_mesh, robot_mesh
from softfuse.robot.robot import build_robot
from softfuse.robot.settings import RobotSettings


def refined_mesh(config: RobotSettings, mesh: RobotMesh) -> RobotMesh:
    """A robot's mesh with every tetrahedron cut into eight, so that of its error a known part is left.
    Meshes made anew with shorter edges scatter by more than is asked here.
    """
    fine = oriented(refined(mesh.mesh))
    middles = [centroid(mesh.mesh.nodes, each.faces) for each in mesh.cavities]
    return robot_mesh(config, fine, cavities(fine, np.array(middles)))


def by_force(plan: DesignPlan, config: RobotSettings, mesh: RobotMesh, every: int, name: str) -> np.ndarray:
    """Readings per newton (s, k) in SI at each so manyth of a plan's places, and a line of them."""
    model = build_robot(config, mesh).model
    places, _ = build_places(plan, config)
    found = np.asarray(rest_response(model, places[::every]).by_force)
    norms = np.linalg.norm(found, axis=1)
    at = jnp.asarray(mesh.mesh.nodes)
    volumes = ", ".join(f"{1e9 * float(Cavity(jnp.asarray(each.faces))(at)):.0f}" for each in mesh.cavities)
    print(f"{name}: {len(at)} nodes, cavities {volumes} mm³")
    print(f"  mean {norms.mean():.5g}/N, variation {norms.std() / norms.mean():.4f}", flush=True)
    return found


def main() -> None:
    """Read the arguments, press, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("plan", type=Path)
    parser.add_argument("dir", type=Path)
    parser.add_argument("--edge", type=float, default=8.0)
    parser.add_argument("--envelope", type=float, default=2.5e-3)
    parser.add_argument("--every", type=int, default=5)
    given = parser.parse_args()
    prepare_jax()
    plan, designed = load_design(given.plan), load(given.dir / "designed.toml")
    source = SurfaceSource.model_validate(
        {
            "type": "surface",
            "file": "casting/body.stl",
            "unit": "mm",
            "edge_length": f"{given.edge} mm",
            "envelope": given.envelope,
        },
        context={"folder": given.dir, "path": given.dir / "designed.toml"},
    )
    filled = designed.model_copy(update={"body": designed.body.model_copy(update={"source": source})})
    surface = by_force(plan, filled, build_mesh(filled), given.every, "surface")
    mesh = build_mesh(designed)
    meshes = {"designed": mesh, "refined": refined_mesh(designed, mesh)}
    for name, mesh in meshes.items():
        own = by_force(plan, designed, mesh, given.every, name)
        mean = np.linalg.norm(own, axis=1).mean()
        norms = np.abs(np.linalg.norm(surface, axis=1) - np.linalg.norm(own, axis=1)) / mean
        each = np.abs(surface - own) / mean
        print(f"  norms off by {norms.mean():.2%} on average, {norms.max():.2%} at most")
        print(f"  single readings off by {each.mean():.2%} on average, {each.max():.2%} at most")


if __name__ == "__main__":
    main()
