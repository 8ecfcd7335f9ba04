"""The channels of a six-axis force-torque sensor."""

from softfuse.errors import HardwareError
from softfuse.hardware.wire.channel import check_name

WRENCH = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
"""Forces [N] and torques [N m] about the sensor's axes."""


def check_wrench(names: tuple[str, ...]) -> tuple[str, ...]:
    """The names, if they can be of three forces and torques; HardwareError or WireError if not."""
    if len(names) != len(WRENCH) or len(set(names)) != len(WRENCH):
        raise HardwareError(
            f"a force-torque sensor has six channels, these are {len(set(names))}: "
            f"name them as in {', '.join(WRENCH)}"
        )
    for name in names:
        check_name(name, "channel")
    return names
