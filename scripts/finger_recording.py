"""Write a recording of the virtual finger of softfuse.experiment.finger_bed; called by finger-recording."""

import dataclasses
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.computing import prepare_jax
from softfuse.cli.terminal import Quiet, stderr, stdout, tracked
from softfuse.errors import SoftfuseError
from softfuse.experiment.finger_bed import (
    CABLE_ALONE,
    TABLE_III,
    TWO_CONTACTS,
    BedSettings,
    write_finger_recording,
)


class Scenario(StrEnum):
    """What is done to the finger."""

    table_iii = "table-iii"
    two_contacts = "two-contacts"
    cable_alone = "cable-alone"


PUSHES = {
    Scenario.table_iii: TABLE_III,
    Scenario.two_contacts: TWO_CONTACTS,
    Scenario.cable_alone: CABLE_ALONE,
}


def main(
    scenario: Annotated[Scenario, typer.Argument(help="What is done to the finger.")],
    path: Annotated[Path, typer.Argument(help="File to write: .csv or .csv.gz.")],
    seed: Annotated[int, typer.Option(help="Another finger with other sensors.")] = 1,
    quiet: Quiet = False,
) -> None:
    """Push on a virtual finger and write what its sensors say."""
    prepare_jax()
    usual = BedSettings(pushes=PUSHES[scenario])
    errors = dataclasses.replace(usual.finger.errors, seed=seed)
    settings = dataclasses.replace(
        usual,
        finger=dataclasses.replace(usual.finger, errors=errors),
        electronics=dataclasses.replace(usual.electronics, seed=seed + 1),
    )
    bar = tracked(range(settings.equilibria), "solving", total=settings.equilibria, quiet=quiet)
    next(bar)
    try:
        write_finger_recording(path, settings, solved=lambda: next(bar, None))
    except SoftfuseError as error:
        stderr.print(f"error: {error}", markup=False, highlight=False, soft_wrap=True)
        raise SystemExit(2) from None
    if not quiet:
        stdout.print(f"{path} holds {scenario}", markup=False, highlight=False)


if __name__ == "__main__":
    typer.run(main)
