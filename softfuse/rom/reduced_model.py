"""The same model with a reduced body."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np
from jaxtyping import Float

from softfuse.functional.cavity import Cavity
from softfuse.mechanics.load import Loads
from softfuse.mechanics.model import Model, parts_of
from softfuse.mechanics.reading import AbstractReading, ShapeReading
from softfuse.rom.basis import RestStiffness
from softfuse.rom.known_inverses import KnownInverses, ReducedDense
from softfuse.rom.projected_ports import projected_contact, projected_load
from softfuse.rom.projected_volume import projected_volumes
from softfuse.rom.projection import project
from softfuse.rom.teaching import Chart


def reduced_model(
    model: Model, stiffness: RestStiffness, chart: Chart, places: Iterable[Float[np.ndarray, "3 3"]]
) -> Model:
    """The model with the body of a chart that was taught by its own, which has that stiffness at rest.

    Chambers become polynomials, actuators and what presses become rows of the modes, patches at `places` (e,
    3, 3) only; other functionals stay, so that the chart must watch their nodes. Raises SoftfuseError when
    the body is a reduced one already, SolveError when an actuator cannot be projected, or the stiffness is
    singular.
    """
    full = model.body.full
    body = project(full, stiffness, chart)
    pressed = np.reshape([*places], (-1, 3, 3))
    readings: list[AbstractReading] = []
    for cavities, reading in volume_readings(model.readings):
        projected = ShapeReading(projected_volumes(cavities, body, chart.reach)) if cavities else reading
        readings.append(projected)
    contacts = tuple(projected_contact(each, full, body, chart.basis, pressed) for each in model.contacts)
    actuators = tuple(projected_load(load, full, body, chart) for load in model.actuators)
    # Contacts' ports are linear: they stiffen nothing.
    known = KnownInverses.of(body, Loads(actuators), chart.typical)
    return replace(
        model,
        body=body,
        linear=ReducedDense.with_known(body, known),
        readings=tuple(readings),
        contacts=contacts,
        actuators=actuators,
    )


def volume_readings(
    readings: Sequence[AbstractReading],
) -> Iterator[tuple[list[Cavity], AbstractReading]]:
    """Readings one by one, also those that are joined, with those of volumes that follow each other as one:
    the cavities, of others none, and the (first) reading.
    """
    each = (one for joined in readings for one in joined.single)
    for volumes, group in groupby(each, lambda one: bool(parts_of(one, Cavity))):
        together = list(group)
        if volumes:
            yield parts_of(together, Cavity), together[0]
        else:
            yield from (([], one) for one in together)
