"""Errors that a user can cause and mend: each says what is wrong, where, and what to do."""


class SoftfuseError(ValueError):
    """A mistake in what the user gave; the command line prints it in one line, without a traceback."""


class MeshError(SoftfuseError):
    """A mesh, surface or region that the mechanics cannot use."""


class ConfigError(SoftfuseError):
    """A configuration file that is incomplete, misspelt or physically impossible."""


class RecordingError(SoftfuseError):
    """A recording that cannot be read or does not belong to the robot."""


class SolveError(SoftfuseError):
    """An equilibrium that was not found; the message names the result and what may help."""


class WireError(SoftfuseError):
    """Bytes, or a description of channels, that the wire protocol does not allow."""


class HardwareError(SoftfuseError):
    """A port, sensor or stage that cannot be opened or does not do what it should."""
