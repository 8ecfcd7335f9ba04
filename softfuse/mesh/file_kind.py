"""What a file holds by its first bytes, against what its ending says."""

from pathlib import Path

from softfuse.errors import MeshError

_BEGIN = 512

_KINDS: tuple[tuple[str, tuple[bytes, ...], tuple[str, ...]], ...] = (
    ("a Gmsh mesh", (b"$MeshFormat",), (".msh", ".msh2", ".msh4")),
    ("a legacy VTK file", (b"# vtk DataFile",), (".vtk",)),
    ("a VTU file", (b'<VTKFile type="UnstructuredGrid"',), (".vtu",)),
    ("a VTP surface", (b'<VTKFile type="PolyData"',), (".vtp",)),
    ("an XDMF file", (b"<Xdmf",), (".xdmf", ".xmf")),
    ("an HDF5 file", (b"\x89HDF\r\n",), (".med", ".h5", ".hdf5", ".h5m", ".hmf", ".cgns", ".e", ".exo")),
    ("a medit mesh", (b"MeshVersionFormatted",), (".mesh", ".medit")),
    ("an Abaqus input file", (b"*HEADING", b"*NODE", b"*PART"), (".inp",)),
    ("a STEP file", (b"ISO-10303-21",), (".step", ".stp")),
    ("an OFF surface", (b"OFF\n", b"OFF\r", b"OFF "), (".off",)),
    ("a PLY file", (b"ply\n", b"ply\r"), (".ply",)),
    ("an STL surface", (b"solid ",), (".stl", ".stla")),
)
"""What it is called, how it begins or, after a comment, what comes soon, and its endings."""


def check_ending(path: Path) -> None:
    """Raise MeshError where a file is of another format than its ending says, as far as this is known."""
    with path.open("rb") as file:
        begin = file.read(_BEGIN)
    for what, marks, endings in _KINDS:
        if _begins(begin, marks, path) and path.suffix.lower() not in endings:
            raise MeshError(
                f"{path} holds {what}, which its ending '{path.suffix}' does not say: rename it to "
                f"{path.stem}{endings[0]}"
            )


def _begins(begin: bytes, marks: tuple[bytes, ...], path: Path) -> bool:
    if marks == (b"solid ",):
        words = int.from_bytes(begin[80:84], "little")
        binary = len(begin) >= 84 and words and path.stat().st_size == 84 + 50 * words
        return bool(binary) or (begin.startswith(marks) and b"facet" in begin)
    text = begin.lstrip()
    if text.startswith((b"<?xml", b"<VTKFile", b"<Xdmf", b"$Comments", b"<!")):
        return any(mark in text for mark in marks if mark.startswith((b"<", b"$")))
    if text.startswith(b"*"):
        return any(mark in text.upper() for mark in marks if mark.startswith(b"*"))
    return text.startswith(marks)
