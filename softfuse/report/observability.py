"""What the sensors of a robot can be expected to tell of a contact, all over where it may be."""

import csv
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.errors import ConfigError
from softfuse.estimation.doubts import TrackerSettings
from softfuse.estimation.model_error import assumed
from softfuse.estimation.uncertainty import Observability, observability, response
from softfuse.report.figures import maps, spots
from softfuse.report.page import page, picture, table
from softfuse.robot.names import named_places
from softfuse.robot.robot import Robot
from softfuse.sensors.base import AbstractSensor, Context, FrameTime

_REST_S, _PRESS_S, _STEP_S = 5.0, 1.0, 0.01
"""For so long sensors are left at rest before something touches, and so long it takes to press; read so
often."""
_FORCE_PART, _PLACE_M = 0.06, 2e-3
"""What is told well: force to this part, place to so much."""


@dataclass(frozen=True, eq=False)
class Expected:
    """What is expected of presses with a force [N] at places (s, 3, 3) of a contact, whose names are known or
    `names` is empty; `seen`: sensors see where it is; `side`: of a grid that the places make, None for none.
    """

    robot: Robot
    contact: str
    force_N: float
    places: Float[np.ndarray, "s 3 3"]
    names: tuple[str, ...]
    found: Observability
    seen: bool
    side: int | None

    @property
    def force_told(self) -> Bool[np.ndarray, " s"]:
        """Where the force is told well (s,)."""
        sigma = self.found.force_sigma_N if self.seen else self.found.blind_force_sigma_N
        return sigma <= _FORCE_PART * self.force_N

    @property
    def place_told(self) -> Bool[np.ndarray, " s"]:
        """Where the place is told well (s,)."""
        sigma = self.found.place_sigma_m if self.seen else self.found.blind_place_sigma_m
        return np.linalg.norm(sigma, axis=1) <= _PLACE_M

    def summary(self) -> list[tuple[str, str]]:
        """Medians and the largest, and where it is told well."""
        blind = np.linalg.norm(self.found.blind_place_sigma_m, axis=1)
        rows = [
            ("force by the readings alone", self.found.blind_force_sigma_N, "N"),
            ("place by the readings alone", 1e3 * blind, "mm"),
        ]
        if self.seen:
            place = 1e3 * np.linalg.norm(self.found.place_sigma_m, axis=1)
            rows = [("force", self.found.force_sigma_N, "N"), ("place", place, "mm"), *rows]
        shares = (
            (f"force known to {100 * _FORCE_PART:.0f} %", self.force_told),
            (f"place known to {1e3 * _PLACE_M:.0f} mm", self.place_told),
            ("both", self.force_told & self.place_told),
        )
        return [
            *(
                (name, f"{np.median(value):.3g} {unit} (median), {np.max(value):.3g} {unit} at most")
                for name, value, unit in rows
            ),
            *((name, f"at {100 * told.mean():.0f} % of the places") for name, told in shares),
        ]

    def write(self, path: Path) -> None:
        """observability.csv: a row for each place; what is not told at all is an empty field."""
        along = ("u_sigma_mm", "v_sigma_mm")
        columns = ("place", "x_mm", "y_mm", "z_mm", "force_N", "force_sigma_N", *along)
        blind = ("blind_force_sigma_N", *(f"blind_{name}" for name in along))
        found = self.found
        values = np.column_stack(
            [
                1e3 * self.places[:, 0],
                np.full(len(self.places), self.force_N),
                found.force_sigma_N,
                1e3 * found.place_sigma_m,
                found.blind_force_sigma_N,
                1e3 * found.blind_place_sigma_m,
                found.singular,
            ]
        )
        names = self.names or ("",) * len(values)
        with path.open("w", newline="") as stream:
            writer = csv.writer(stream)
            writer.writerow([*columns, *blind, *(f"singular{k}" for k in range(3))])
            for name, row in zip(names, values, strict=True):
                writer.writerow([name, *(f"{v:.6g}" if np.isfinite(v) else "" for v in row)])

    def html(self, place_sigma_mm: float) -> str:
        """The page."""
        found = self.found
        place, blind = (
            1e3 * np.linalg.norm(each, axis=1) for each in (found.place_sigma_m, found.blind_place_sigma_m)
        )
        alone = {"force [N]": found.blind_force_sigma_N, "log10 of place [mm]": np.log10(blind)}
        singular = {f"singular value {k}": found.singular[:, k] for k in range(3)}
        sections = [
            (f"Standard deviations under {self.force_N:g} N", table(("of", "value"), self.summary())),
            (
                "By the readings alone",
                self._drawn(alone, "What nothing sees is told by what nothing else explains."),
            ),
            (
                "What is told",
                self._drawn(
                    singular,
                    "Singular values of the whitened slopes, per N and per mm: below 1, a newton or a "
                    "millimetre in that direction is lost in noise.",
                ),
            ),
        ]
        if self.seen:
            known = {"force [N]": found.force_sigma_N, "place [mm]": place}
            caption = f"Where sensors that see contacts know a place to {place_sigma_mm:g} mm."
            sections.insert(1, ("With sensors that see contacts", self._drawn(known, caption)))
        return page(f"{self.robot.name}: observability", sections)

    def _drawn(self, values: dict[str, Float[np.ndarray, " s"]], caption: str) -> str:
        at = 1e3 * self.places[:, 0]
        if self.side is None:
            return picture(spots(at, values), caption)
        grid = {name: value.reshape(self.side, self.side) for name, value in values.items()}
        x, y = at[:: self.side, 0], at[: self.side, 1]
        return picture(maps(x, y, grid), caption)


def expected(
    robot: Robot,
    contact: str | None,
    force_N: float,
    *,
    side: int,
    place_sigma_m: float,
    held_s: float,
    begin: Callable[[int], Callable[[], None]],
) -> Expected:
    """Of a contact by name, None for the only one, that has touched for so long [s], on a grid of side x side
    places, or at those of its surface; sensors that see contacts know a place to `place_sigma_m` [m].

    `begin` is called with how many places there are; what it returns is called after each. Raises ConfigError
    where nothing is known of where the contact may be, SolveError when a press has no equilibrium.
    """
    settings = robot.settings.contact(contact)
    number = robot.settings.contacts.index(settings)
    slot = robot.addresses.slots[settings.name].start
    workspace, named = robot.workspaces[slot], named_places(robot.settings, settings.name)
    if workspace is None and not named:
        raise ConfigError(
            f'{robot.settings.path}: contact "{settings.name}": nothing says where it may be: give its '
            "surface, or electrodes that see it"
        )
    places = np.stack([*named.values()]) if workspace is None else workspace.grid(side)[0]
    model = replace(robot.model, contacts=(robot.model.contacts[number],), slots=())
    answer = response(model, places, force_N, seen=begin(len(places)))
    alone, one = bool(robot.unseen[slot]), np.array([force_N])
    error = assumed(TrackerSettings.of(robot).model_error, robot.reading_kinds, alone=alone)
    covariance = np.array(
        [
            error.covariance(reading, sigma, place[None], one)
            for reading, sigma, place in zip(
                answer.reading, reading_sigma(robot, held_s, answer.reading), places, strict=True
            )
        ]
    )
    found = observability(answer, covariance, place_sigma_m)
    names = tuple(named) if workspace is None else ()
    grid = None if settings.direction is None else side
    return Expected(robot, settings.name, force_N, places, names, found, not alone, grid)


def reading_sigma(
    robot: Robot, held_s: float, readings: Float[np.ndarray, "s k"]
) -> Float[np.ndarray, "s k"]:
    """Standard deviations (s, k) [SI] that the sensors give these readings (s, k) [SI] when what causes them
    has been held for so long [s].
    """
    time = np.arange(0.0, _REST_S + _PRESS_S + held_s, _STEP_S)
    part = np.clip((time - _REST_S) / _PRESS_S, 0.0, 1.0)
    found = [np.zeros((len(readings), 0))]
    settings = {each.name: each for each in robot.settings.sensors}
    for sensor in robot.suite.sensors:
        own = readings[:, robot.addresses.readings[sensor.name]]
        raw = [settings[sensor.name].ideal(robot.parts, time, np.outer(part, each)) for each in own]
        last = jax.vmap(partial(_last_sigma, sensor, jnp.asarray(time)))
        found.append(np.asarray(last(jnp.asarray(np.array(raw)))))
    return np.concatenate(found, axis=1)


def _last_sigma(
    sensor: AbstractSensor, time: Float[Array, " m"], raw: Float[Array, "m n"]
) -> Float[Array, " k"]:
    """What a sensor says of its readings (k,) [SI] after raw ones (m, n) at times (m,) [s]."""

    def step(state: Any, now: tuple[Array, Array]) -> tuple[Any, Array]:
        time_s, raw = now
        touching, no = time_s >= _REST_S, jnp.asarray(False)
        frame = FrameTime(time_s, jnp.where(time_s > 0, _STEP_S, 0.0), ~no, no, time_s == 0)
        context = Context(touching, touching, no, ~touching, no, ~touching, no)
        state, measured = sensor.update(state, frame, raw, context)
        return state, measured.sigma

    return jax.lax.scan(step, sensor.init(), (time, raw))[1][-1]
