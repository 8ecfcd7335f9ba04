"""All kinds of sources of meshes by the `type` of [body.source], but layouts, which need more than a mesh: a
new one is a file of its own and a name here.
"""

from softfuse.mesh.file_source import MeshSource, SurfaceSource
from softfuse.mesh.finger import FingerSource
from softfuse.mesh.pad import PadSource

MeshedSource = PadSource | FingerSource | SurfaceSource | MeshSource
