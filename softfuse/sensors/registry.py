"""All kinds of sensors by the `type` of their [[sensor]] table: a new one is a file of its own and a line
here.
"""

from collections.abc import Mapping
from types import MappingProxyType

from softfuse.sensors.base import SensorSettings
from softfuse.sensors.base_wrench import BaseWrenchSettings
from softfuse.sensors.cable_length import CableLengthSettings
from softfuse.sensors.cable_tension import CableTensionSettings
from softfuse.sensors.crossed.settings import CrossedSettings
from softfuse.sensors.curvature import BraggSettings
from softfuse.sensors.electrodes import ElectrodeSettings
from softfuse.sensors.embedded_line import LineLengthSettings, LiquidMetalSettings
from softfuse.sensors.embedded_sheet import SheetSettings
from softfuse.sensors.flow import FlowSettings
from softfuse.sensors.indenter import IndenterSettings
from softfuse.sensors.marker import MarkerSettings
from softfuse.sensors.mutual.settings import MutualSettings
from softfuse.sensors.orientation import AccelerometerSettings, AttitudeSettings
from softfuse.sensors.point_pressure import PointPressureSettings
from softfuse.sensors.pressure.settings import PressureSettings
from softfuse.sensors.strain_gauge import StrainGaugeSettings

SENSORS: Mapping[str, type[SensorSettings]] = MappingProxyType(
    {
        "flow": FlowSettings,
        "pressure": PressureSettings,
        "crossed-diamonds": CrossedSettings,
        "mutual-4x4": MutualSettings,
        "electrodes": ElectrodeSettings,
        "cable-length": CableLengthSettings,
        "cable-tension": CableTensionSettings,
        "marker": MarkerSettings,
        "accelerometer": AccelerometerSettings,
        "attitude": AttitudeSettings,
        "liquid-metal": LiquidMetalSettings,
        "line-length": LineLengthSettings,
        "dielectric-sheet": SheetSettings,
        "bragg-gratings": BraggSettings,
        "point-pressure": PointPressureSettings,
        "base-wrench": BaseWrenchSettings,
        "indenter": IndenterSettings,
        "strain-gauge": StrainGaugeSettings,
    }
)
