"""From a fresh process to the first estimate, with an empty and with a warm cache of compiled programs.

    .venv/bin/python benchmarks/cold_start.py [--out FOLDER] [--runs N] [--config FILE] [--recording FILE] \
        [--charts FOLDER]

Each run is a new Python process that goes from its first import to the first frame of a recording in which
something touches, through the Python API or as `softfuse estimate` does, on the full body or on its charts.
Every first run has an empty JAX compilation cache of its own, the others the one that it left. Printed and
written to cold_start.json: medians over the runs of wall time and of CPU time of all threads, for each phase:
the imports, config, mesh, robot, tracker (with the seconds that JAX spent tracing, lowering and in XLA), the
frames up to the estimate, and in all, interpreter included; of the command, all that comes before the
tracker's first frame is one phase.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
JAX_PHASES = {
    "/jax/core/compile/jaxpr_trace_duration": "trace",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lower",
    "/jax/core/compile/backend_compile_duration": "compile",
}
"""JAX's own events; those of programs compiled at once overlap, and a hit in the cache is one too."""
ROWS = ("import", "config", "mesh", "robot", "tracker", "first estimate", "all")


class Phases:
    """Wall and CPU seconds of one phase after the other."""

    def __init__(self):
        self.seconds: dict[str, tuple[float, float]] = {}
        self.jax: dict[str, float] = dict.fromkeys((*JAX_PHASES.values(), "programs"), 0.0)
        self._last = time.perf_counter(), time.process_time()

    def end(self, name: str) -> None:
        """What happened since the last phase was this one."""
        now = time.perf_counter(), time.process_time()
        self.seconds[name] = now[0] - self._last[0], now[1] - self._last[1]
        self._last = now

    def listen(self) -> None:
        """Add up what JAX reports from here on."""
        import jax

        def heard(event: str, duration_secs: float, **_) -> None:
            if event in JAX_PHASES:
                self.jax[JAX_PHASES[event]] += duration_secs
                self.jax["programs"] += JAX_PHASES[event] == "compile"

        jax.monitoring.register_event_duration_secs_listener(heard)

    def tell(self) -> None:
        """Print as JSON and end, without waiting for anything."""
        print(json.dumps({"seconds": self.seconds, "jax": self.jax}), flush=True)
        os._exit(0)


def through_api(given: argparse.Namespace) -> None:
    """The phases of the Python API in this process."""
    phases = Phases()
    from softfuse.computing.prepare import prepare_jax
    from softfuse.estimation.tracker import Tracker
    from softfuse.report.presses import read_sensors, sensor_frames
    from softfuse.robot.file import load
    from softfuse.robot.mesh import build_mesh
    from softfuse.robot.reduced import with_charts
    from softfuse.robot.robot import build_robot

    prepare_jax()
    phases.end("import")
    phases.listen()
    settings = load(given.config)
    phases.end("config")
    mesh = build_mesh(settings)
    phases.end("mesh")
    robot = build_robot(settings, mesh)
    model = with_charts(robot, given.charts)
    phases.end("robot")
    tracker = Tracker(robot, model)
    phases.end("tracker")
    frames = sensor_frames(settings, read_sensors(settings, given.recording))
    any(np.isfinite(found.misfit).any() for found in map(tracker.update, frames))
    phases.end("first estimate")
    phases.tell()


def through_command(given: argparse.Namespace) -> None:
    """The phases of `softfuse estimate` in this process, which ends with the first estimate."""
    phases = Phases()
    from softfuse.cli.app import main
    from softfuse.estimation.tracker import Tracker

    phases.end("import")
    phases.listen()
    estimate = Tracker.estimate

    def watched(self, time_s, finding):
        if "tracker" not in phases.seconds:
            phases.end("tracker")
        found = estimate(self, time_s, finding)
        if np.isfinite(found.misfit).any():
            phases.end("first estimate")
            phases.tell()
        return found

    Tracker.estimate = watched
    charts = ["--charts", str(given.charts)] if given.charts else []
    told = ["--out", str(given.out / "estimated"), "--quiet", *charts]
    main(["estimate", str(given.config), str(given.recording), *told])


WAYS: dict[str, Callable[[argparse.Namespace], None]] = {"api": through_api, "command": through_command}


def run(way: str, given: argparse.Namespace, folder: Path) -> dict[str, dict]:
    """One process, measured from outside."""
    arguments = [__file__, "--way", way, "--config", given.config, "--recording", given.recording]
    arguments += ["--charts", given.charts] if given.charts else []
    environment = os.environ | {
        "JAX_COMPILATION_CACHE_DIR": str(folder / "jax"),
        "XDG_CACHE_HOME": str(folder),
        "PYTHONPATH": os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]),
    }
    before, started = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    ended = subprocess.run(
        [sys.executable, *map(str, arguments), "--out", str(folder)],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    wall, after = time.perf_counter() - started, resource.getrusage(resource.RUSAGE_CHILDREN)
    if ended.returncode:
        raise SystemExit(ended.stderr)
    told = json.loads(ended.stdout)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    told["seconds"]["all"] = wall, cpu
    return told


def middle(runs: list[dict[str, dict]]) -> dict[str, dict]:
    """Medians over runs."""
    return {
        key: {name: np.median([run[key][name] for run in runs], axis=0).tolist() for name in runs[0][key]}
        for key in runs[0]
    }


def table(columns: dict[str, dict[str, dict]]) -> str:
    """The phases' wall and CPU seconds, and what JAX reported in them, of each column."""
    lines = [f"{'':>16}" + "".join(f"{name:>24}" for name in columns)]
    lines.append(f"{'[s]':>16}" + f"{'wall':>16}{'CPU':>8}" * len(columns))
    for name in ROWS:
        cells = [column["seconds"].get(name) for column in columns.values()]
        lines.append(
            f"{name:>16}" + "".join(f"{c[0]:16.2f}{c[1]:8.2f}" if c else f"{'-':>16}{'-':>8}" for c in cells)
        )
    for name in (*JAX_PHASES.values(), "programs"):
        lines.append(f"{name:>16}" + "".join(f"{c['jax'][name]:16.4g}{'':8}" for c in columns.values()))
    return "\n".join(lines)


def main() -> None:
    """Run the processes, print the table, write JSON; or be one of the processes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=3, help="empty caches, each followed by two warm runs")
    parser.add_argument("--config", type=Path, default=ROOT / "configs" / "pad.toml")
    parser.add_argument(
        "--recording", type=Path, default=ROOT / "tests" / "data" / "pad_nominal_two_presses.csv.gz"
    )
    parser.add_argument("--charts", type=Path, help="what softfuse reduce made of the config")
    parser.add_argument("--way", choices=WAYS, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.way:
        WAYS[given.way](given)
        return
    columns = {}
    for way in WAYS:
        cold, warm = [], []
        for _ in range(given.runs):
            with tempfile.TemporaryDirectory() as folder:
                cold.append(run(way, given, Path(folder)))
                warm += [run(way, given, Path(folder)) for _ in range(2)]
        columns |= {f"{way}, empty cache": middle(cold), f"{way}, warm cache": middle(warm)}
        print(table(columns), flush=True)
    given.out.mkdir(parents=True, exist_ok=True)
    (given.out / "cold_start.json").write_text(json.dumps(columns, indent=2) + "\n")


if __name__ == "__main__":
    main()
