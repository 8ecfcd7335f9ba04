"""The same device with a reduced body."""

from dataclasses import replace

from softfuse.estimation.device import Device
from softfuse.functional.cavity import Cavity
from softfuse.reduction.chart import Chart
from softfuse.reduction.projected_volume import projected_volume
from softfuse.reduction.rolling_inverse import ReducedDense


def reduced_device(device: Device, chart: Chart) -> Device:
    """The device with the body of a chart that was made from its own; cavities become polynomials, other
    functionals stay, so that the chart must watch their nodes.
    """
    body = chart.body
    sensors = tuple(
        projected_volume(sensor, body, chart.amplitudes) if isinstance(sensor, Cavity) else sensor
        for sensor in device.sensors
    )
    return replace(device, body=body, linear=ReducedDense.plan(body), sensors=sensors)
