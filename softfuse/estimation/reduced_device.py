"""The same device with a reduced body."""

from dataclasses import replace

from softfuse.body.body import Body
from softfuse.errors import SolveError
from softfuse.estimation.device import Device
from softfuse.functional.cavity import Cavity
from softfuse.reduction.chart import Chart
from softfuse.reduction.projected_volume import projected_volume
from softfuse.reduction.projection import project
from softfuse.reduction.rest_stiffness import RestStiffness
from softfuse.reduction.rolling_inverse import ReducedDense


def reduced_device(device: Device, stiffness: RestStiffness, chart: Chart) -> Device:
    """The device with the body of a chart that was taught by its own, which has that stiffness at rest.

    Cavities become polynomials; other functionals stay, so that the chart must watch their nodes. Raises
    SolveError when the device's body is a reduced one already.
    """
    if not isinstance(device.body, Body):
        raise SolveError("the device's body is a reduced one already: reduce the full device")
    body = project(device.body, stiffness, chart)
    sensors = tuple(
        projected_volume(sensor, body, chart.reach) if isinstance(sensor, Cavity) else sensor
        for sensor in device.sensors
    )
    return replace(device, body=body, linear=ReducedDense.plan(body), sensors=sensors)
