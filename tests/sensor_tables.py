"""One table of each kind of sensor, for the block of tests/sensors."""

from typing import Any

from softfuse.sensors.base import SensorSettings
from softfuse.sensors.registry import SENSORS

LINES = [f"{k} mm" for k in range(-28, 29, 8)]
WIDE = [f"{k} mm" for k in (-24, -8, 8, 24)]

TABLES: dict[str, dict[str, Any]] = {
    "flow": {"part": "D6F-P0001A1", "channels": ["f0", "f1"], "chambers": ["right", "left"]},
    "pressure": {
        "part": "MPX5100A",
        "channels": ["p0", "p1"],
        "chambers": ["sealed", "driven"],
        "reference_channel": "supply",
    },
    "crossed-diamonds": {
        "contact": "top",
        "channels": [f"line{k}" for k in range(16)],
        "row_y": LINES,
        "column_x": LINES,
        "row_depth": "1.5 mm",
        "column_depth": "1 mm",
        "row_baseline": [20000.0] * 8,
        "column_baseline": [20000.0] * 8,
    },
    "mutual-4x4": {
        "contact": "top",
        "channels": [f"cell{k}" for k in range(16)],
        "row_y": WIDE,
        "column_x": WIDE,
    },
    "electrodes": {
        "contact": "skin",
        "channels": ["e0", "e1"],
        "electrodes": [
            {"name": "a", "centre": ["0 mm", "0 mm", "18 mm"], "direction": [0, 0, -1], "along": [0, 1, 0]},
            {"name": "b", "centre": ["35 mm", "0 mm", "9 mm"], "direction": [-1, 0, 0]},
        ],
    },
    "cable-length": {"channels": ["l0", "l1"], "cables": ["one", "other"]},
    "cable-tension": {"channels": ["t0", "t1"], "cables": ["other", "one"]},
    "marker": {"channels": ["mx", "mz"], "point": "tip", "components": ["x", "z"]},
    "accelerometer": {"channels": ["ax", "ay", "az"], "point": "tip"},
    "attitude": {
        "channels": ["qw", "qx", "qy", "qz"],
        "point": "tip",
        "axes": [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
    },
    "liquid-metal": {
        "channels": ["r0", "r1"],
        "path": [["-30 mm", "0 mm", "15 mm"], ["0 mm", "0 mm", "15 mm"], ["30 mm", "0 mm", "15 mm"]],
        "stations": [0, 1, 2],
        "resistance": "4 ohm",
    },
    "line-length": {"channels": ["s"], "path": [["-30 mm", "0 mm", "15 mm"], ["30 mm", "0 mm", "15 mm"]]},
    "dielectric-sheet": {
        "channels": ["c"],
        "centre": ["0 mm", "0 mm", "15 mm"],
        "edges": [["20 mm", "0 mm", "0 mm"], ["0 mm", "10 mm", "0 mm"]],
        "capacitance": "180 pF",
    },
    "bragg-gratings": {
        "channels": [f"w{k}" for k in range(6)],
        "path": [["-30 mm", "0 mm", "15 mm"], ["30 mm", "0 mm", "15 mm"]],
        "stations": ["20 mm", "40 mm"],
        "angles": ["0 deg", "120 deg", "240 deg"],
        "distance": "0.05 mm",
        "across": [0, 0, 1],
        "wavelengths": "1550 nm",
        "temperature_channel": "warm",
    },
    "base-wrench": {"channels": ["fx", "fy", "fz", "mx", "my", "mz"], "carried": ["one"]},
    "point-pressure": {"channels": ["b"], "point": "tip", "gain": 2.0},
    "strain-gauge": {"channels": ["g"], "path": [["-30 mm", "0 mm", "15 mm"], ["30 mm", "0 mm", "15 mm"]]},
    "indenter": {"channels": ["ix", "iy", "iF"], "contact": "top"},
}
"""Keys of each kind besides its name, as they are written."""


def settings_of(kind: str, **changed: Any) -> SensorSettings:
    """A sensor of a kind, named after it; changed: keys."""
    return SENSORS[kind].model_validate({"name": kind, "type": kind} | TABLES[kind] | changed)
