"""The serial ports that this computer has, without opening any."""

import os
from dataclasses import dataclass


@dataclass(frozen=True)
class SerialPort:
    """A port's name, what its device says that it is, and whether this user may open it.

    What the device says comes from the device: to be escaped before it reaches a terminal.
    """

    name: str
    description: str
    allowed: bool


def serial_ports() -> list[SerialPort]:
    """All of them, by name."""
    from serial.tools import list_ports

    return sorted(
        (SerialPort(port.device, _described(port), _allowed(port.device)) for port in list_ports.comports()),
        key=lambda port: port.name,
    )


def _described(port) -> str:
    said = [port.description, port.manufacturer, port.serial_number]
    return ", ".join(dict.fromkeys(text for text in said if text and text != "n/a"))


def _allowed(name: str) -> bool:
    # Only where ports are files.
    return not os.path.exists(name) or os.access(name, os.R_OK | os.W_OK)
