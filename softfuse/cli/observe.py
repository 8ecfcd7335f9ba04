"""softfuse observe: how well a device would tell force and place of a contact, all over its workspace."""

import csv
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from softfuse.calibration.grid import Grid
from softfuse.cli.estimate import make_folder
from softfuse.cli.terminal import Quiet, busy, stdout, tracked_calls
from softfuse.config.build_device import build_device
from softfuse.config.build_tracker import build_model_error
from softfuse.config.contact import DiscSettings
from softfuse.errors import ConfigError
from softfuse.estimation.observability import Observability, observability, response
from softfuse.functional.chart import facing
from softfuse.report.observability_figures import maps
from softfuse.report.page import page, picture, table
from softfuse.robot.file import load


def observe(
    config: Annotated[Path, typer.Argument(help="Configuration of the device (TOML).")],
    out: Annotated[Path, typer.Option(help="Folder for observability.csv and report.html.")],
    force: Annotated[float, typer.Option(help="Force of the contact in N.", min=0.01)] = 5.0,
    side: Annotated[int, typer.Option(help="Places in each direction.", min=2)] = 13,
    volume_sigma: Annotated[
        float, typer.Option(help="Noise of a measured volume change in mm³.", min=1e-6)
    ] = 0.6,
    place_sigma: Annotated[
        float, typer.Option(help="How well the electrodes know a place, in mm.", min=1e-6)
    ] = 0.2,
    quiet: Quiet = False,
) -> None:
    """Map the errors of force and place that a device can be expected to have, before it is built."""
    settings = load(config)
    contact = settings.contact
    if not isinstance(contact, DiscSettings):
        raise ConfigError(f'{config}: contact.model: a workspace is that of discs, not of a "patch"')
    error = build_model_error(settings)
    make_folder(out)
    with busy("meshing", quiet=quiet):
        device = build_device(settings)
    grid = Grid.over(contact.workspace.x, contact.workspace.y, force, side)
    places = facing(grid.point_m, np.array(contact.direction))
    with tracked_calls("pressing", total=len(places), quiet=quiet) as seen:
        answer = response(device, places, force, seen=seen)
    noise, one = np.full(answer.reading.shape[1], 1e-9 * volume_sigma), np.array([force])
    covariance = np.array(
        [
            error.covariance(reading, noise, place[None], one)
            for reading, place in zip(answer.reading, places, strict=True)
        ]
    )
    found = observability(answer, covariance, 1e-3 * place_sigma)
    _write(out / "observability.csv", places, force, found)
    report = _report(settings.device.name, grid, found, place_sigma)
    (out / "report.html").write_text(report, encoding="utf-8")
    if not quiet:
        lines = [f"{name}: {value}" for name, value in _summary(found)]
        stdout.print("\n".join([*lines, f"written to {out}"]), markup=False, highlight=False, soft_wrap=True)


def _write(path: Path, places: np.ndarray, force: float, found: Observability) -> None:
    columns = ("x_mm", "y_mm", "force_N", "force_sigma_N", "x_sigma_mm", "y_sigma_mm")
    blind = ("blind_force_sigma_N", "blind_x_sigma_mm", "blind_y_sigma_mm")
    values = np.column_stack(
        [
            1e3 * places[:, 0, :2],
            np.full(len(places), force),
            found.force_sigma_N,
            1e3 * found.place_sigma_m,
            found.blind_force_sigma_N,
            1e3 * found.blind_place_sigma_m,
            found.singular,
        ]
    )
    with path.open("w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow([*columns, *blind, *(f"singular{k}" for k in range(3))])
        # What is not told at all is an empty field.
        writer.writerows([[f"{v:.6g}" if np.isfinite(v) else "" for v in row] for row in values])


def _summary(found: Observability) -> list[tuple[str, str]]:
    """Medians and the largest."""
    blind = np.linalg.norm(found.blind_place_sigma_m, axis=1)
    place = np.linalg.norm(found.place_sigma_m, axis=1)
    rows = (
        ("force", found.force_sigma_N, "N"),
        ("place", 1e3 * place, "mm"),
        ("force by the cavities alone", found.blind_force_sigma_N, "N"),
        ("place by the cavities alone", 1e3 * blind, "mm"),
    )
    return [
        (name, f"{np.median(value):.3g} {unit} (median), {np.max(value):.3g} {unit} at most")
        for name, value, unit in rows
    ]


def _report(
    name: str,
    grid: Grid,
    found: Observability,
    place_sigma: float,
) -> str:
    x_mm, y_mm, shape = 1e3 * grid.x_m, 1e3 * grid.y_m, (len(grid.x_m), len(grid.y_m))
    place, blind = (
        1e3 * np.linalg.norm(each, axis=1).reshape(shape)
        for each in (found.place_sigma_m, found.blind_place_sigma_m)
    )
    with_place = {"force [N]": found.force_sigma_N.reshape(shape), "place [mm]": place}
    alone = {"force [N]": found.blind_force_sigma_N.reshape(shape), "log10 of place [mm]": np.log10(blind)}
    singular = {f"singular value {k}": found.singular[:, k].reshape(shape) for k in range(3)}
    sections = [
        (f"Standard deviations under {grid.each_N:g} N", table(("of", "value"), _summary(found))),
        (
            "With electrodes",
            picture(maps(x_mm, y_mm, with_place), f"Where electrodes know a place to {place_sigma:g} mm."),
        ),
        (
            "By the cavities alone",
            picture(maps(x_mm, y_mm, alone), "What the electrodes miss is still felt by the cavities."),
        ),
        (
            "What is told",
            picture(
                maps(x_mm, y_mm, singular),
                "Singular values of the whitened slopes, per N and per mm: below 1, a newton or a millimetre "
                "in that direction is lost in noise.",
            ),
        ),
    ]
    return page(f"{name}: observability", sections)
