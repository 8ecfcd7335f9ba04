"""Write a recording of a virtual finger that rigid tips push on; called by finger-recording."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from softfuse.cli.options import Quiet
from softfuse.cli.progress import tracked_calls
from softfuse.cli.terminal import stderr, stdout
from softfuse.computing.prepare import prepare_jax
from softfuse.errors import SoftfuseError
from softfuse.experiment.paper.bed import finger_bed
from softfuse.experiment.paper.pushes import CABLE_ALONE, TABLE_III, TWO_CONTACTS
from softfuse.experiment.performance import in_turn
from softfuse.experiment.recording_file import write_recording
from softfuse.mesh.finger import FingerSource
from softfuse.robot.file import load

CONFIG = Path(__file__).parents[1] / "configs" / "finger.toml"


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
    try:
        settings = load(CONFIG)
        assert isinstance(settings.body.source, FingerSource)
        bed = finger_bed(settings, settings.body.source, PUSHES[scenario], seed=seed)
        with tracked_calls("solving", total=bed.equilibria, quiet=quiet) as solved:
            played = in_turn(bed.played(None, solved))
        write_recording(path, played.recording(seed, 1))
    except SoftfuseError as error:
        stderr.print(f"error: {error}", markup=False, highlight=False, soft_wrap=True)
        raise SystemExit(2) from None
    if not quiet:
        stdout.print(f"{path} holds {scenario}", markup=False, highlight=False)


if __name__ == "__main__":
    typer.run(main)
