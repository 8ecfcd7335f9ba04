"""Every test runs in double precision, as the mechanics requires; a small model of two chambers, and robots
of configs/ on coarse meshes.
"""

import gc
import os
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path

from packaging.version import Version

# Programs run once or twice here: without its newer emitters XLA compiles them in three quarters of the time.
# Later ones do not know the option, which ends the process without a word.
if Version(metadata.version("jaxlib")) < Version("0.11"):
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_cpu_use_fusion_emitters=false"

import checks

checks.install()

import hypothesis
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from made_sensors import mutual_model

from softfuse.body import LINEAR, TAYLOR_HOOD, Body, mesh_for
from softfuse.body.element import Element
from softfuse.calibration.mutual_grid import KnownTouches, fit_mutual_model
from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.functional.cavity import Cavity
from softfuse.functional.contact import ContactSurface
from softfuse.functional.pressure_cells import flat_punch
from softfuse.material import NeoHookean
from softfuse.mechanics.dense import Dense
from softfuse.mechanics.indenters import FlatIndenter
from softfuse.mechanics.linear_solver import AbstractLinearSolver
from softfuse.mechanics.model import Model
from softfuse.mechanics.multifrontal import Multifrontal
from softfuse.mechanics.reading import ShapeReading
from softfuse.mesh.pad import PadGeometry, pad_mesh
from softfuse.mesh.surface import cavities, outer_surface
from softfuse.report.paper_evaluation import image_of
from softfuse.sensors.mutual.field import Thing
from softfuse.sensors.mutual.model import MutualModel

jax.config.update("jax_enable_x64", True)

# How long an example takes says how busy the machine is.
hypothesis.settings.register_profile("untimed", deadline=None)
hypothesis.settings.load_profile("untimed")

MM = 1e-3

COARSE = (
    ('wall_size = "10 mm"', 'wall_size = "20 mm"'),
    ('base_size = "8 mm"', 'base_size = "30 mm"'),
    ("growth = 2.0", "growth = 9.0"),
)
WITH_LINEAR_TETS = (
    ('element = "taylor-hood"', 'element = "linear"'),
    # With a high Poisson's ratio linear elements lock.
    ("poisson = 0.49", "poisson = 0.3"),
)


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """A cache folder of the tests' own, where each finds the programs that others have compiled."""
    base = tmp_path_factory.getbasetemp()
    # Workers that test side by side share one.
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "cache"
    with pytest.MonkeyPatch.context() as patch:
        for name in ("XDG_CACHE_HOME", "HOME", "LOCALAPPDATA"):
            patch.setenv(name, str(folder))
        jax.config.update("jax_compilation_cache_dir", str(folder / "softfuse" / "jax"))
        yield


MOST_MAPS = 20_000
"""Of a process' memory, out of the 65,530 that Linux lets it have."""


@pytest.fixture(scope="module", autouse=True)
def forgotten_programs() -> Iterator[None]:
    """After a file's tests, JAX forgets its compiled programs when these have become many.

    Each keeps its pieces of memory mapped; where no more can be mapped, LLVM aborts the process.
    """
    yield
    maps = Path("/proc/self/maps")
    if maps.exists() and len(maps.read_bytes().splitlines()) > MOST_MAPS:
        jax.clear_caches()
        gc.collect()


def two_cavity_device(element: Element, solver: type[AbstractLinearSolver], poisson: float) -> Model:
    """A block of 70 × 40 × 18 mm over two cavities, some hundred nodes, pressed by a punch of 8 mm."""
    geometry = PadGeometry(
        (70 * MM, 40 * MM, 18 * MM), (26 * MM, 28 * MM, 6 * MM), ((-17 * MM, 0.0), (17 * MM, 0.0)), 6 * MM
    )
    mesh = mesh_for(element, pad_mesh(geometry, 40 * MM, 40 * MM))
    law = NeoHookean.from_young(0.6e6, poisson)
    body = Body.from_mesh(mesh, [law], mesh.nodes[:, 2] < 1e-9, element=element)
    faces = outer_surface(mesh).faces
    surface = ContactSurface.facing(faces, mesh.nodes, np.array([0.0, 0.0, -1.0]))
    contact = FlatIndenter(surface, flat_punch((0.7, 1.0), (3, 6)), 8 * MM)
    inner = (Cavity(jnp.asarray(s.faces)) for s in cavities(mesh, geometry.centres()))
    readings = tuple(ShapeReading(cavity) for cavity in inner)
    return Model(body, readings, (contact,), solver.plan(body))


@pytest.fixture(scope="session")
def model() -> Model:
    """The small robot as it is used: Taylor-Hood, nearly incompressible, multifrontal solver."""
    return two_cavity_device(TAYLOR_HOOD, Multifrontal, 0.49)


@pytest.fixture(scope="session")
def plain_device() -> Model:
    """The small robot with linear elements and a dense solver, which compile in no time."""
    return two_cavity_device(LINEAR, Dense, 0.3)


@pytest.fixture(scope="session")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """configs/pad.toml on the coarsest mesh, which is compiled soonest."""
    text = (Path(__file__).parents[1] / "configs" / "pad.toml").read_text(encoding="utf-8")
    for key, value in (("surface_size", "30 mm"), ("base_size", "28 mm"), ("fine_depth", "0 mm")):
        start = text.index(f"{key} = ")
        end = text.index('"', text.index('"', start) + 1)
        text = f'{text[:start]}{key} = "{value}{text[end:]}'
    path = tmp_path_factory.mktemp("config") / "coarse.toml"
    path.write_text(text)
    return path


@pytest.fixture(scope="session")
def coarse_finger(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Writes configs/finger.toml with a coarse mesh and, `coarse_finger((old, new), ...)`, more replaced."""
    whole = (Path(__file__).parents[1] / "configs" / "finger.toml").read_text(encoding="utf-8")

    def write(*changes: tuple[str, str]) -> Path:
        text = whole
        for old, new in (*COARSE, *changes):
            assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the configuration"
            text = text.replace(old, new)
        path = tmp_path_factory.mktemp("finger") / "finger.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


@pytest.fixture(scope="session")
def linear_finger(coarse_finger: Callable[..., Path]) -> Callable[..., Path]:
    """The same with linear elements too, which compile and step in no time and are too stiff."""
    return lambda *changes: coarse_finger(*WITH_LINEAR_TETS, *changes)


@pytest.fixture(scope="session")
def calibrated_grid() -> Callable[[MutualBed, float], MutualModel]:
    """calibrated_grid(bed, radius): a grid's drawing, and touches of a finger on and between its cells."""

    def calibrated(bed: MutualBed, radius: float) -> MutualModel:
        x, y = bed.field.column_x, bed.field.row_y
        half = 0.5 * (x[1] - x[0])
        on = [(a, b) for a in x for b in y]
        along_x = [(a + half, b) for a in x[:-1] for b in y[::2]]
        between = along_x + [(a, b + half) for a in x[::2] for b in y[:-1]]
        width = 2 * bed.field.half_width
        drawn = mutual_model(x, y, electrode_width=width, depth=bed.field.depth, finger_radius=radius)

        def touches(places: list[tuple[float, float]], force: float) -> KnownTouches:
            things = [Thing(at, force=force, radius=radius) for at in places]
            return KnownTouches(np.array([image_of(bed, [thing]) for thing in things]), np.array(places))

        return fit_mutual_model(drawn, touches(on + between, 0.0), touches(between, 5.0))

    return calibrated
