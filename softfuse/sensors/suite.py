"""All sensors of a robot: one frame of raw readings to readings in SI, contacts and their places.

Whatever the sensors are, a frame goes as `base` says. Contacts are the slots of each [[contact]], one after
the other; something that only gas tells of is taken for the first contact that its sensors, or none at all,
may miss.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.errors import ConfigError
from softfuse.sensors.base import (
    AbstractContactSensor,
    AbstractSensor,
    Context,
    Evidence,
    Hint,
    Measurement,
    SensorSettings,
    Touch,
    VolumeChange,
)
from softfuse.sensors.contact_places import ContactSlots, joined_places
from softfuse.sensors.frame_time import FrameClock, FrameTime, clock_init, frame_step
from softfuse.sensors.parts import Parts
from softfuse.sensors.pneumatic_touch import (
    PneumaticDetector,
    PneumaticState,
    pneumatic_init,
    pneumatic_update,
)
from softfuse.sensors.status import Status
from softfuse.sensors.zero_drift import DriftModel, ReadingDrift

_START_S = 2.0
"""Time at rest after a robot is switched on that nobody watches: enough for zeros to be taken."""


@dataclass(frozen=True)
class Addresses:
    """Which of a row of numbers belong to whom: names, and where each one's begin, and the end of all."""

    names: tuple[str, ...]
    starts: tuple[int, ...]

    @classmethod
    def of(cls, counts: Sequence[tuple[str, int]]) -> "Addresses":
        """Of names with so many numbers each."""
        starts = np.cumsum([0, *(count for _, count in counts)]).tolist()
        return cls(tuple(name for name, _ in counts), tuple(starts))

    def __getitem__(self, name: str) -> slice:
        """The numbers that belong to a name."""
        k = self.names.index(name)
        return slice(self.starts[k], self.starts[k + 1])


class Observation(NamedTuple):
    """One frame of k readings and c contacts."""

    reading: Float[Array, " k"]
    """(k,) readings since rest [SI]."""
    sigma: Float[Array, " k"]
    """(k,) their standard deviations."""
    valid: Bool[Array, " k"]
    """(k,) take part in the estimate."""
    touching: Bool[Array, " c"]
    """(c,) something touches here."""
    pressing: Bool[Array, " c"]
    """(c,) touches at a place that is allowed, known or to be told by the readings: it may have a force."""
    clear: Bool[Array, ""]
    """Nothing is near that could press: what the model misses now is its own error."""
    places: Float[Array, "c 3 3"]
    """(c, 3, 3) where contacts are taken to press, see `functional.chart`."""
    location_m: Float[Array, "c 3"]
    """(c, 3) middles of the contacts on the body at rest; NaN where unseen or where nothing touches [m]."""
    location_sigma_m: Float[Array, "c 2"]
    """(c, 2) standard deviations of places along their tangents; NaN where unknown [m]."""
    flags: dict[str, Bool[Array, ""]]
    """What is to be said about the frame, and whether it is."""
    details: dict[str, Any]
    """What each sensor knows besides, by its name."""
    drift: ReadingDrift | None
    """What the readings drift by; None where `SensorSuite.drift` is."""


class SuiteState(eqx.Module):
    """Memory between frames: time and that of the first frame [s], of each sensor, of what only gas tells,
    and the last volumes.
    """

    clock: FrameClock
    begun_s: Float[Array, ""]
    sensors: tuple[Any, ...]
    contacts: tuple[Any, ...]
    pneumatic: PneumaticState
    volume: VolumeChange


class SensorSuite(eqx.Module):
    """Sensors that measure, sensors that see contacts, and the contacts; pure, causal, one frame after the
    other.
    """

    sensors: tuple[AbstractSensor, ...]
    contact_sensors: tuple[AbstractContactSensor, ...]
    contacts: tuple[ContactSlots, ...]
    pneumatic: PneumaticDetector
    channels: tuple[str, ...] = eqx.field(static=True)
    """All raw channels, as `update` wants them."""
    inputs: Addresses = eqx.field(static=True)
    """Where the raw channels of each sensor are."""
    readings: tuple[str, ...] = eqx.field(static=True)
    """Names of all readings."""
    outputs: Addresses = eqx.field(static=True)
    """Where the readings of each sensor are."""

    @classmethod
    def of(cls, settings: Sequence[SensorSettings], parts: Parts) -> "SensorSuite":
        """The sensors of a robot, in the order given.

        Raises ConfigError when two have the same name, write in the same channel, or do not go with the
        parts.
        """
        made = [each.sensor(parts) for each in settings]
        _unlike([each.name for each in made], "sensors are named")
        channels = [channel for each in made for channel in each.channels]
        _unlike(channels, "sensors write in the column")
        measuring, seeing = list[AbstractSensor](), list[AbstractContactSensor]()
        for each in made:
            if isinstance(each, AbstractSensor):
                measuring.append(each)
                continue
            seeing.append(each)
            if each.slots != parts.contacts[each.contact].slots:
                raise ConfigError(
                    f'sensor "{each.name}" sees {each.slots} contact at once, "{each.contact}" allows '
                    f"{parts.contacts[each.contact].slots}: allow as many as it sees"
                )
        contacts = tuple(
            ContactSlots(
                name,
                part.slots,
                tuple(k for k, each in enumerate(seeing) if each.contact == name),
                part.chart,
                jnp.asarray(part.low, float),
                jnp.asarray(part.high, float),
                jnp.asarray(part.somewhere, float),
            )
            for name, part in parts.contacts.items()
        )
        return cls(
            tuple(measuring),
            tuple(seeing),
            contacts,
            PneumaticDetector.usual(),
            tuple(channels),
            Addresses.of([(each.name, len(each.channels)) for each in made]),
            tuple(name for each in measuring for name in each.readings),
            Addresses.of([(each.name, len(each.readings)) for each in measuring]),
        )

    @property
    def units(self) -> tuple[str, ...]:
        """The SI unit of each reading, see `AbstractSensor.units`."""
        return tuple(unit for each in self.sensors for unit in each.units)

    @property
    def slots(self) -> int:
        """How many contacts are followed, c."""
        return sum(contact.slots for contact in self.contacts)

    @property
    def misses(self) -> bool:
        """Whether a contact may press that is seen nowhere, so that only readings tell its place."""
        return self._missed is not None

    @property
    def drift(self) -> DriftModel | None:
        """How readings drift while something presses, those that do not by nothing; None where none does."""
        models = [each.drift for each in self.sensors]
        if all(model is None for model in models):
            return None
        counts = [len(each.readings) for each in self.sensors]
        return DriftModel.joined(models, counts)

    def init(self) -> SuiteState:
        """State before the first frame; nothing touches, unless a sensor tells."""
        chambers = len(self._chambers)
        return SuiteState(
            clock_init(),
            jnp.full((), jnp.inf, float),
            tuple(each.init() for each in self.sensors),
            tuple(each.init() for each in self.contact_sensors),
            pneumatic_init(),
            VolumeChange(jnp.zeros(chambers), jnp.zeros(chambers, bool)),
        )

    def update(
        self, state: SuiteState, time_s: Float[Array, ""], raw: Float[Array, " n"]
    ) -> tuple[SuiteState, Observation]:
        """One frame at `time_s` [s] of raw readings (n,) in the order of `channels`; NaN stands for what is
        missing.
        """
        clock, frame = frame_step(state.clock, time_s)
        inputs, driven = self.inputs, jnp.asarray(False)
        for each, own in zip(self.sensors, state.sensors, strict=True):
            driven = driven | each.driven(own, raw[inputs[each.name]])
        hints = [each.hint(own) for each, own in zip(self.sensors, state.sensors, strict=True)]
        # What an actuator moves squeezes gas as well.
        hint = Hint.joined([each for each in hints if each is not None]).still(driven)
        seeing, touches = list[Any](), list[Touch]()
        for each, own in zip(self.contact_sensors, state.contacts, strict=True):
            seen, touch = each.touch(own, frame, raw[inputs[each.name]], hint)
            seeing.append(seen)
            touches.append(touch)
        near = _any([touch.near for touch in touches])
        pneumatic = state.pneumatic
        if self._missed is not None:
            pneumatic = pneumatic_update(self.pneumatic, pneumatic, frame.dt_s, hint, state.volume, near)
        unseen = pneumatic.touching
        clear = ~_any([~touch.clear for touch in touches]) & ~unseen
        begun = jnp.minimum(state.begun_s, jnp.where(frame.forward, frame.now_s, jnp.inf))
        if self.blind:
            # Where nothing tells of a touch, the body is taken to rest when it is switched on, and not later.
            clear = clear & ~(frame.now_s - begun > _START_S)
        context = Context(
            near=near | unseen,
            touching=_any([jnp.any(touch.touching) for touch in touches]) | unseen,
            unseen=unseen,
            clear=clear,
            driven=driven,
            resting=clear & ~near & ~driven,
            begun_touched=_any([touch.begun for touch in touches]),
        )
        measured, later = list[Measurement](), list[Any]()
        for each, own in zip(self.sensors, state.sensors, strict=True):
            own, measurement = each.update(own, frame, raw[inputs[each.name]], context)
            later.append(own)
            measured.append(measurement)
        volume = self._volume(measured)
        evidence, located = list[Evidence](), list[Any]()
        for each, seen in zip(self.contact_sensors, seeing, strict=True):
            own, found = each.locate(seen, frame, context, _squeezed(volume))
            located.append(own)
            evidence.append(found)
        memory = SuiteState(clock, begun, tuple(later), tuple(located), pneumatic, volume)
        return memory, self._observation(frame, context, measured, evidence)

    @property
    def blind(self) -> bool:
        """Whether a contact may press of which no sensor and no gas tells, so that only readings can."""
        gas = any(each.chambers for each in self.sensors)
        return not gas and any(not contact.seen_by for contact in self.contacts)

    @property
    def _missed(self) -> int | None:
        """Number of the first contact that may press unseen while gas tells of it."""
        gas = any(each.chambers for each in self.sensors)
        for k, contact in enumerate(self.contacts):
            if gas and all(self.contact_sensors[one].misses for one in contact.seen_by):
                return k
        return None

    @property
    def _chambers(self) -> dict[str, tuple[int, int]]:
        """For each chamber whose volume is told, the first sensor that does, and the number of it there."""
        told: dict[str, tuple[int, int]] = {}
        for k, each in enumerate(self.sensors):
            for number, chamber in enumerate(each.chambers):
                told.setdefault(chamber, (k, number))
        return told

    def _volume(self, measured: Sequence[Measurement]) -> VolumeChange:
        change, valid = [jnp.zeros(0)], [jnp.zeros(0, bool)]
        by_sensor: dict[int, list[int]] = {}
        for k, number in self._chambers.values():
            by_sensor.setdefault(k, []).append(number)
        for k, numbers in by_sensor.items():
            told = measured[k].volume
            assert told is not None  # the sensor names its chambers
            change.append(told.change_m3[np.array(numbers)])
            valid.append(told.valid[np.array(numbers)])
        return VolumeChange(jnp.concatenate(change), jnp.concatenate(valid))

    def _observation(
        self,
        frame: FrameTime,
        context: Context,
        measured: Sequence[Measurement],
        evidence: Sequence[Evidence],
    ) -> Observation:
        valid = jnp.concatenate([jnp.zeros(0, bool), *(each.valid for each in measured)])
        told, no = jnp.any(valid), jnp.asarray(False)
        columns = [self._contact(k, context, evidence) for k in range(len(self.contacts))]
        nothing = jnp.zeros(0, bool), jnp.zeros(0, bool), jnp.zeros(0, bool), jnp.zeros(0, bool)
        nowhere = jnp.zeros((0, 3, 3)), jnp.zeros((0, 2))
        touching, located, allowed, unseen, places, sigma = map(
            jnp.concatenate, zip((*nothing, *nowhere), *columns, strict=True)
        )
        pressing = allowed | unseen
        flags = {Status.bad_time: ~frame.forward, Status.clock_anew: frame.anew}
        for each in (*measured, *evidence):
            flags |= each.flags
        flags |= {
            Status.location_unknown: jnp.any(touching & ~located & ~unseen),
            Status.unseen: jnp.any(unseen),
            Status.outside: jnp.any(located & ~allowed),
            Status.nothing_measured: jnp.any(pressing) & ~told if len(self.readings) else no,
        }
        names = [each.name for each in (*self.sensors, *self.contact_sensors)]
        details = {name: each.details for name, each in zip(names, (*measured, *evidence), strict=True)}
        return Observation(
            reading=jnp.concatenate([jnp.zeros(0), *(each.value for each in measured)]),
            sigma=jnp.concatenate([jnp.zeros(0), *(each.sigma for each in measured)]),
            valid=valid,
            touching=touching,
            pressing=pressing & told,
            clear=context.clear,
            places=places,
            location_m=jnp.where(located[:, None], places[:, 0], jnp.nan),
            location_sigma_m=sigma,
            flags=flags,
            details=details,
            drift=self._drift(frame, measured),
        )

    def _contact(self, number: int, context: Context, evidence: Sequence[Evidence]):
        """touching, located, allowed, unseen (c,), places (c, 3, 3), sigma (c, 2) of a contact's slots."""
        contact = self.contacts[number]
        seen = [evidence[k] for k in contact.seen_by]
        no = jnp.zeros(contact.slots, bool)
        unseen = no.at[0].set(context.unseen) if number == self._missed else no
        places, anywhere = contact.waiting(), (contact.high_m - contact.low_m) / jnp.sqrt(12.0)
        touching = located = allowed = no
        variance = jnp.full((contact.slots, 2), jnp.nan)
        if len(seen) == 1:
            (one,) = seen
            touching, located, allowed = one.touching, one.located, one.allowed
            places, variance = one.place, jnp.diagonal(one.covariance, axis1=1, axis2=2)
        elif seen:
            touching = jnp.any(jnp.stack([one.touching for one in seen]), axis=0)
            by = jnp.stack([one.located for one in seen])
            located, allowed = jnp.any(by, axis=0), jnp.any(jnp.stack([one.allowed for one in seen]), axis=0)
            places, covariance = joined_places(
                jnp.stack([one.place for one in seen]), jnp.stack([one.covariance for one in seen]), by
            )
            variance = jnp.diagonal(covariance, axis1=1, axis2=2)
        if number == self._missed:
            # What nobody sees may be anywhere.
            middle = contact.at(0.5 * (contact.low_m + contact.high_m)[None])
            places = jnp.where(unseen[:, None, None], middle, places)
        sigma = jnp.where(located[:, None], jnp.sqrt(variance), jnp.nan)
        sigma = jnp.where(unseen[:, None], anywhere, sigma)
        return touching | unseen, located & ~unseen, allowed & ~unseen, unseen, places, sigma

    def _drift(self, frame: FrameTime, measured: Sequence[Measurement]) -> ReadingDrift | None:
        drifts = [each.drift for each in measured]
        if all(each is None for each in drifts):
            return None
        each = [
            (jnp.zeros((len(one.readings), 3, 3)), jnp.zeros(len(one.readings), bool))
            if drift is None
            else drift[:2]
            for one, drift in zip(self.sensors, drifts, strict=True)
        ]
        return ReadingDrift(*map(jnp.concatenate, zip(*each, strict=True)), period_s=frame.dt_s)


def _any(flags: Sequence[Bool[Array, ""]]) -> Bool[Array, ""]:
    return jnp.any(jnp.stack(list(flags))) if flags else jnp.asarray(False)


def _squeezed(volume: VolumeChange) -> Float[Array, ""]:
    """What has gone out of all chambers [m³]; of one whose volume was lost as much as of that which tells
    most.
    """
    told = jnp.where(volume.valid, -volume.change_m3, 0.0)
    lost = jnp.sum(~volume.valid) * jnp.max(told, initial=0.0)
    return jnp.maximum(jnp.sum(told) + lost, 0.0)


def _unlike(names: Sequence[str], what: str) -> None:
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise ConfigError(f'two {what} "{min(twice)}": give each its own')
