"""Configuration files to validated, typed settings, and settings to what the other stages work with."""

from softfuse.config.device import DeviceConfig
from softfuse.config.file import load, parse, save_edited

__all__ = ["DeviceConfig", "load", "parse", "save_edited"]
