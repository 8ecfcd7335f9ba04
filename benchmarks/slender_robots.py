"""How long equilibria of soft slender robots take: a pneumatic finger that sags, trunks pulled by cables.

    .venv/bin/python benchmarks/slender_robots.py ROBOTS [--beside CHECKOUT] [--only CASE ...] [--json FILE]

ROBOTS is a folder with trunk.toml, 150 mm with three cables and chambers, and pneunet.toml, five cells on a
strip, both made of surfaces, as commit 6d474a5 reads them: they are rewritten for this one. A third robot is
drawn here: a trunk of 200 mm with eight cables of ten guides each, of which one is shortened by 20 mm. Every
case is one `softfuse simulate` as a process of its own, run twice, with an empty cache of compiled programs
and with what the first run left there; --beside runs each case of a checkout of 6d474a5 right before. Told
are seconds on the wall and of the processor, with meshing and compilation, the equilibrium's iterations, and
how the search ended.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import tomlkit

HERE = Path(__file__).parents[1]
LENGTH, ROOT, TIP = 0.2, 0.016, 0.008
CABLES, GUIDES, SIDES, RINGS = 8, 10, 24, 21


class Case(NamedTuple):
    """A config with some of its text replaced, and what is done to the robot: which electrode is pressed how
    hard, and which cable is shortened by how much.
    """

    name: str
    config: str
    edits: dict[str, str] = {}
    press: tuple[str, ...] = ()
    cable: tuple[str, ...] = ()


YOUNG, GRAVITY = 'young = "0.125 MPa"', 'gravity = ["0 m/s^2", "0 m/s^2", "-9.81 m/s^2"]'
CASES = (
    Case("trunk", "trunk.toml", press=("tip 0", "0.1"), cable=("cable 0", "6 mm")),
    Case("finger_soft", "pneunet.toml"),
    Case("finger_stiff", "pneunet.toml", {YOUNG: 'young = "0.6 MPa"'}),
    Case("finger_tip", "pneunet.toml", {GRAVITY: ""}, press=("tip palm", "0.02")),
    Case("eight_cables", "eight.toml", cable=("0", "20 mm")),
)


def rewritten(old: dict[str, Any]) -> dict[str, Any]:
    """A configuration of 6d474a5 as one of today; sensors but the electrodes are left out, no equilibrium
    needs them.
    """
    gas, contact, electrodes = old.get("gas"), old["contact"], old["electrode"]
    spans = [next(filter(lambda part: float(part.split()[0]), place["span"])) for place in electrodes]
    along = [[float(float(part.split()[0]) != 0) for part in place["span"]] for place in electrodes]
    sealed = {} if gas is None else {"gas": "sealed"} | {k: v for k, v in gas.items() if k != "atmosphere"}
    body = {key: value for key, value in old["body"].items() if key != "gravity"}
    return {
        "robot": old["device"],
        "body": body,
        "environment": {
            "gravity": old["body"].get("gravity", ["0 m/s^2"] * 3),
            "atmosphere": "101.325 kPa" if gas is None else gas["atmosphere"],
        },
        "chamber": [{**cavity, **sealed} for cavity in old.get("cavity", [])],
        "cable": old.get("cable", []),
        "contact": [
            {
                "name": "hand",
                **{key: contact[key] for key in ("model", "radius", "max_force")},
                "span": spans[0],
                "place_sigma": contact.get("place_sigma", "3 mm"),
            }
        ],
        "sensor": [
            {
                "name": "skin",
                "type": "electrodes",
                "contact": "hand",
                "channels": [f"e{k}" for k in range(len(electrodes))],
                "electrodes": [
                    {
                        **{key: place[key] for key in ("name", "centre", "direction")},
                        "along": way,
                        "size": [span, span],
                    }
                    for place, span, way in zip(electrodes, spans, along, strict=True)
                ],
            }
        ],
        "point": old.get("point", []),
        **{key: old[key] for key in ("centreline", "estimator") if key in old},
    }


def tapered(folder: Path) -> None:
    """Write the trunk with eight cables, eight.toml and its surface."""
    import trimesh

    around = 2 * np.pi * np.arange(SIDES) / SIDES
    height = np.linspace(0.0, LENGTH, RINGS)
    radius = ROOT + (TIP - ROOT) * height / LENGTH
    ring = np.stack([np.cos(around), np.sin(around)], axis=1)
    rings = zip(radius, height, strict=True)
    side = np.concatenate([np.column_stack([r * ring, np.full(SIDES, z)]) for r, z in rings])
    nodes = np.concatenate([side, [[0, 0, 0], [0, 0, LENGTH]]])
    k, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    faces = [np.stack([np.full(SIDES, len(side)), after, k], axis=1)]
    for low in SIDES * np.arange(RINGS - 1):
        faces += [
            np.stack([low + k, low + after, low + SIDES + after], axis=1),
            np.stack([low + k, low + SIDES + after, low + SIDES + k], axis=1),
        ]
    top = SIDES * (RINGS - 1)
    faces.append(np.stack([np.full(SIDES, len(side) + 1), top + k, top + after], axis=1))
    trimesh.Trimesh(1e3 * nodes, np.concatenate(faces)).export(folder / "eight.stl")

    def place(at) -> str:
        return "[" + ", ".join(f'"{1e3 * x:.4f} mm"' for x in at) + "]"

    lines = [
        '[device]\nname = "Eight cables"\n[body.source]\ntype = "surface"\nfile = "./eight.stl"\nunit = "mm"',
        'edge_length = "10 mm"\n[[body.material]]\nlaw = "neo-hookean"\nyoung = "0.262 MPa"\npoisson = 0.49',
        '[body.fixed]\nz = ["0 mm", "0 mm"]\n[contact]\nmodel = "patch"\nradius = "3 mm"\nmax_force = "2 N"',
        'max_contacts = 1\n[[electrode]]\nname = "tip"\ncentre = ["9.6 mm", "0 mm", "160 mm"]',
        'direction = [-1, 0, 0]\nspan = ["0 mm", "0 mm", "8 mm"]',
    ]
    for cable in range(CABLES):
        angle = 2 * np.pi * cable / CABLES
        z = np.linspace(0.005, LENGTH - 0.005, GUIDES)
        r = 0.7 * (ROOT + (TIP - ROOT) * z / LENGTH)
        guides = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
        below = (r[0] * np.cos(angle), r[0] * np.sin(angle), -0.01)
        lines += [
            f'[[cable]]\nname = "{cable}"\nguides = [{", ".join(place(at) for at in guides)}]',
            f'pulled_at = {place(below)}\nanchor_radius = "1.5 mm"\nfriction = 0.1\nmax_tension = "20 N"',
        ]
    (folder / "eight.toml").write_text("\n".join(lines) + "\n")


def timed(checkout: Path, config: Path, given: Sequence[str], cache: Path) -> dict[str, Any]:
    """One `softfuse simulate` of a checkout."""
    numbers = cache.with_suffix(".json")
    numbers.unlink(missing_ok=True)
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ended = subprocess.run(
        [sys.executable, "-m", "softfuse", "simulate", config, *given, "--quiet", "--json", numbers],
        env={**os.environ, "JAX_COMPILATION_CACHE_DIR": str(cache)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        cwd=checkout,  # Python looks there first, before any folder of its path
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = json.loads(numbers.read_text()) if numbers.exists() else {}
    return {
        "wall_s": time.perf_counter() - begin,
        "cpu_s": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "iterations": found.get("newton_iterations"),
        "result": found.get("result", f"failed: {ended.stderr}"),
        "bend_deg": found.get("tip_bend_deg"),
        "dof": found.get("dof"),
    }


def main() -> None:
    """Run the cases, print a line of each run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("robots", type=Path)
    parser.add_argument("--beside", type=Path, help="another checkout of softfuse")
    parser.add_argument("--only", nargs="+", choices=[case.name for case in CASES])
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    rows = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        tapered(folder)
        for path in given.robots.glob("*.stl"):
            (folder / path.name).symlink_to(path.resolve())
        for case in CASES if given.only is None else [c for c in CASES if c.name in given.only]:
            source = folder if case.config == "eight.toml" else given.robots
            text = (source / case.config).read_text()
            for there, instead in case.edits.items():
                assert there in text, (case.name, there)
                text = text.replace(there, instead)
            old, new = folder / f"old_{case.config}", folder / f"new_{case.config}"
            old.write_text(text)
            new.write_text(tomlkit.dumps(rewritten(tomllib.loads(text))))
            before = [x for pair in zip(("--electrode", "--force"), case.press, strict=False) for x in pair]
            today = [x for pair in zip(("--at", "--force"), case.press, strict=False) for x in pair]
            if case.cable:
                before += ["--cable", case.cable[1]]
                today += ["--cable", "=".join(case.cable)]
            for label, checkout, config, done in (
                ("beside", given.beside, old, before),
                ("here", HERE, new, today),
            ):
                for cache in ("cold", "warm") if checkout else ():
                    row = timed(checkout, config, done, folder / f"{label}_{case.name}")
                    rows.append({"case": case.name, "checkout": label, "cache": cache, **row})
                    print(*(f"{key} {value}" for key, value in rows[-1].items()), sep="  ", flush=True)
    if given.json is not None:
        given.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
