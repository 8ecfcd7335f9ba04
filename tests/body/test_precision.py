"""Single precision is refused with a word on what to do."""

import subprocess
import sys

CODE = """
import numpy as np
from softfuse.body import Body
from softfuse.errors import SoftfuseError
from softfuse.material import NeoHookean
from softfuse.mesh.tetmesh import tet_mesh
nodes = np.vstack([np.zeros(3), np.eye(3)])
mesh = tet_mesh(nodes, np.array([[0, 1, 2, 3]]))
try:
    Body.from_mesh(mesh, [], np.array([True, False, False, False]))
except SoftfuseError as error:
    assert "jax_enable_x64" in str(error), error
else:
    raise SystemExit("no error")
"""


def test_single_precision_is_refused() -> None:
    done = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
