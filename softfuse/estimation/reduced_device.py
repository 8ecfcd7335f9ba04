"""The same device with a reduced body."""

from dataclasses import replace
from itertools import groupby

from softfuse.body.body import Body
from softfuse.errors import SolveError
from softfuse.estimation.device import Device
from softfuse.functional.base import AbstractFunctional
from softfuse.functional.cavity import Cavity
from softfuse.mechanics.load import Loads
from softfuse.mechanics.patch import PatchContact
from softfuse.mechanics.punch import PunchContact
from softfuse.rom.chart import Chart
from softfuse.rom.known_inverses import KnownInverses, ReducedDense
from softfuse.rom.projected_ports import projected_discs, projected_load, projected_patches
from softfuse.rom.projected_volume import projected_volumes
from softfuse.rom.projection import project
from softfuse.rom.rest_stiffness import RestStiffness


def reduced_device(device: Device, stiffness: RestStiffness, chart: Chart) -> Device:
    """The device with the body of a chart that was taught by its own, which has that stiffness at rest.

    Cavities become polynomials, what is attached and what presses become rows of the modes; other functionals
    stay, so that the chart must watch their nodes. Raises SolveError when the device's body is a reduced one
    already, something is attached that cannot be projected, or the stiffness is singular.
    """
    full = device.body
    if not isinstance(full, Body):
        raise SolveError("the device's body is a reduced one already: reduce the full device")
    body = project(full, stiffness, chart)
    sensors: list[AbstractFunctional] = []
    for _, alike in groupby(device.sensors, type):
        group = list(alike)
        cavities = [sensor for sensor in group if isinstance(sensor, Cavity)]
        sensors += [projected_volumes(cavities, body, chart.reach)] if cavities else group
    contact = device.contact
    if isinstance(contact, PatchContact):
        contact = projected_patches(contact, full, chart.basis)
    elif isinstance(contact, PunchContact):
        contact = projected_discs(contact, body)
    attached = tuple(projected_load(load, full, body, chart) for load in device.attached)
    # Contacts' ports are linear: they stiffen nothing.
    known = KnownInverses.of(body, Loads(attached), chart.typical)
    return replace(
        device,
        body=body,
        linear=ReducedDense.with_known(body, known),
        sensors=tuple(sensors),
        contact=contact,
        attached=attached,
    )
