"""A stage by its port and by what controls it."""

from enum import StrEnum

from softfuse.errors import HardwareError
from softfuse.hardware.source.connection import remedy
from softfuse.hardware.source.serial_port import open_serial
from softfuse.hardware.stage.gcode import GcodeStage
from softfuse.hardware.stage.grbl import Grbl
from softfuse.hardware.stage.marlin import Marlin
from softfuse.hardware.stage.workspace import Workspace


class Firmware(StrEnum):
    """What a stage is controlled by."""

    GRBL = "grbl"
    MARLIN = "marlin"


def open_stage(url: str, baud: int, firmware: Firmware, workspace: Workspace) -> GcodeStage:
    """The stage at a port, to be connected, which may go where the workspace allows; HardwareError where the
    port cannot be opened.
    """
    try:
        port = open_serial(url, baud)
    except OSError as error:
        raise HardwareError(remedy(url, error)) from error
    return GcodeStage(port, Grbl() if firmware is Firmware.GRBL else Marlin(), workspace)
