"""The robots of configs/: each loads, and bodies of scripts/gallery_bodies.py are closed and small."""

from pathlib import Path

import pytest

from softfuse.mesh.files import read_surface
from softfuse.robot.file import load

CONFIGS = Path(__file__).parents[2] / "configs"
ROBOTS = {
    "pad": ("flow", "crossed-diamonds"),
    "pad_mutual": ("flow", "mutual-4x4"),
    "pad_sealed": ("pressure", "crossed-diamonds"),
    "fluidic_pad": ("pressure", "pressure"),
    "finger": ("pressure", "electrodes", "cable-length"),
    "finger_lines": ("liquid-metal", "liquid-metal", "accelerometer", "cable-length", "base-wrench"),
    "trunk": ("marker", "marker"),
    "pneunet": ("point-pressure", "bragg-gratings"),
    "dome": ("pressure",),
}
"""The sensors of each."""


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_loads_with_its_sensors(name: str) -> None:
    settings = load(CONFIGS / f"{name}.toml")
    assert tuple(sensor.type for sensor in settings.sensors) == ROBOTS[name]
    assert len(set(settings.channels)) == len(settings.channels) and settings.contacts


@pytest.mark.parametrize(
    ("name", "parts", "volume_mm3", "size"),
    [
        ("trunk", 4, 88e3, 12_000),
        ("dome", 5, 41.5e3, 42_000),
        ("pneunet", 1, 34.8e3, 12_000),
        ("pneunet_chamber", 1, 11.26e3, 12_000),
    ],
)
def test_its_body_is_closed(name: str, parts: int, volume_mm3: float, size: int) -> None:
    import trimesh

    path = CONFIGS / "bodies" / f"{name}.stl"
    assert path.stat().st_size < size
    mesh = trimesh.load_mesh(path)
    assert mesh.is_watertight and mesh.body_count == parts
    assert mesh.volume == pytest.approx(volume_mm3, rel=0.08)
    assert len(read_surface(path, scale=1e-3).nodes) == len(mesh.vertices)
