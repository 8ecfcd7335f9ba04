"""What all sensors have in common: their settings, filters from raw channels to SI, and what they tell each
other.

A frame is worked through in this order (`suite`): hints of what begins, from the frames before; touch, from
sensors that see contacts; a touch that only gas tells (`pneumatic_touch`); the `Context` of these; the
readings of all other sensors; the places of contacts. All of it is pure and causal: it runs live, and in a
`jax.lax.scan` over a recording. NaN stands for a raw reading that is missing.
"""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float
from pydantic import AfterValidator, BeforeValidator, model_validator

from softfuse.errors import ConfigError
from softfuse.functional.chart import FlatChart
from softfuse.io.quantity import PositiveNumber, wrong_value
from softfuse.io.settings import NotEmpty, Settings, listed
from softfuse.sensors.electronics import ChannelElectronics, Converter
from softfuse.sensors.frame_time import FrameTime
from softfuse.sensors.zero_drift import DriftModel, ReadingDrift

if TYPE_CHECKING:
    from softfuse.mechanics.reading import AbstractReading
    from softfuse.sensors.parts import Parts, TrueContact


class Hint(NamedTuple):
    """What k channels of gas said up to the last frame about a touch that begins.

    `outflow` (k,): gas that is squeezed, of late [standard deviations], negative where a chamber widens;
    `begins` (k,): it may be a touch that begins, not the end of one; `level` (k,): it says how far gas is
    squeezed, for as long as it is, not how fast.
    """

    outflow: Float[Array, " k"]
    begins: Bool[Array, " k"]
    level: Bool[Array, " k"]

    @classmethod
    def joined(cls, hints: Sequence["Hint"]) -> "Hint":
        """Those of several sensors."""
        nothing = cls(jnp.zeros(0), jnp.zeros(0, bool), jnp.zeros(0, bool))
        return cls(*map(jnp.concatenate, zip(nothing, *hints, strict=True)))

    def still(self, still: Bool[Array, "..."]) -> "Hint":
        """Nothing flows in channels (k,), or all, where `still`."""
        return self._replace(outflow=jnp.where(still, 0.0, self.outflow))

    def squeezed(self) -> Float[Array, ""]:
        """The largest outflow, 0 when an inflow is larger still: a release squeezes no chamber, though it
        moves gas out of the neighbours; 0 without any channel.
        """
        outflow, inflow = (jnp.max(each, initial=0.0) for each in (self.outflow, -self.outflow))
        return jnp.where(outflow > inflow, outflow, 0.0)


class VolumeChange(NamedTuple):
    """Changes of volume (k,) [m³] of chambers, and whether they are known (k,)."""

    change_m3: Float[Array, " k"]
    valid: Bool[Array, " k"]


class Touch(NamedTuple):
    """What one sensor sees of the c contacts that it looks for.

    `near`: something is near or touches; `touching` (c,); `clear`: nothing is so near that it could press;
    `begun`: something touched before the first frame.
    """

    near: Bool[Array, ""]
    touching: Bool[Array, " c"]
    clear: Bool[Array, ""]
    begun: Bool[Array, ""]


class Context(NamedTuple):
    """What all sensors know of a frame together.

    Something is `near`; it is `touching`; only gas tells of it, `unseen`; nothing is so near that it could
    press, `clear`; an actuator is `driven`; nothing is near or driven, the body is `resting`; something
    touched before the first frame, `begun_touched`.
    """

    near: Bool[Array, ""]
    touching: Bool[Array, ""]
    unseen: Bool[Array, ""]
    clear: Bool[Array, ""]
    driven: Bool[Array, ""]
    resting: Bool[Array, ""]
    begun_touched: Bool[Array, ""]


class Measurement(NamedTuple):
    """k readings of a frame: values since rest and standard deviations (k,) [SI], whether they count (k,),
    what is to be said about them; what they drift by, None where they do not; changes of the chambers'
    volumes that they tell, None where they tell none; and whatever else the sensor knows.
    """

    value: Float[Array, " k"]
    sigma: Float[Array, " k"]
    valid: Bool[Array, " k"]
    flags: dict[str, Bool[Array, ""]]
    drift: ReadingDrift | None = None
    volume: VolumeChange | None = None
    details: Any = None


class Image(NamedTuple):
    """What electrodes see: values (r, s) at heights y_m (r,) and at x_m (s,) [m] of the contact's chart."""

    values: Float[np.ndarray, "r s"]
    x_m: Float[np.ndarray, " s"]
    y_m: Float[np.ndarray, " r"]


class Evidence(NamedTuple):
    """What one sensor says of its c contacts.

    `touching` (c,); `located` (c,): it is known where; `allowed` (c,): and a contact may press there; `place`
    (c, 3, 3), see `functional.chart`; `covariance` (c, 2, 2) along the place's tangents [m²]; flags and
    details as those of a Measurement.
    """

    touching: Bool[Array, " c"]
    located: Bool[Array, " c"]
    allowed: Bool[Array, " c"]
    place: Float[Array, "c 3 3"]
    covariance: Float[Array, "c 2 2"]
    flags: dict[str, Bool[Array, ""]]
    details: Any = None


class SeenPlace(NamedTuple):
    """A named place (3, 3) at which a [[contact]] is seen, the covariance (2, 2) [m²] along its tangents of
    one that may press anywhere there, and the key of the sensor's settings that says it.
    """

    key: str
    name: str
    contact: str
    place: Float[np.ndarray, "3 3"]
    covariance: Float[np.ndarray, "2 2"]


class AbstractSensor(eqx.Module):
    """Some channels and the readings that they measure; everything but names is a leaf."""

    name: str = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    readings: tuple[str, ...] = eqx.field(static=True)
    units: tuple[str, ...] = eqx.field(static=True)
    """The SI unit of each reading, such as "m", "m^3", "Pa", "N" or "rad"; "" of a plain number."""
    chambers: tuple[str, ...] = eqx.field(static=True)
    """Chambers whose changes of volume it tells."""

    @property
    def drift(self) -> DriftModel | None:
        """How its readings drift while something presses; None where they do not."""
        return None

    @abstractmethod
    def init(self) -> Any:
        """State before the first frame."""

    def hint(self, state: Any) -> Hint | None:
        """What it said up to the last frame of a touch that begins; None where it never does."""
        del state
        return None

    def driven(self, state: Any, raw: Float[Array, " n"]) -> Bool[Array, ""]:
        """Whether raw readings (n,) tell that an actuator is driven."""
        del state, raw
        return jnp.asarray(False)

    @abstractmethod
    def update(
        self, state: Any, frame: FrameTime, raw: Float[Array, " n"], context: Context
    ) -> tuple[Any, Measurement]:
        """One frame of raw readings (n,), NaN where missing."""


class AbstractContactSensor(eqx.Module):
    """Some channels that see the contacts of one [[contact]], in `slots`."""

    name: str = eqx.field(static=True)
    channels: tuple[str, ...] = eqx.field(static=True)
    contact: str = eqx.field(static=True)
    slots: int = eqx.field(static=True)
    misses: ClassVar[bool]
    """Whether something may press that it does not see."""

    @abstractmethod
    def init(self) -> Any:
        """State before the first frame; nothing touches."""

    def image(self, details: Any) -> Image | None:
        """What it sees, of the details of its evidence; None of one that makes no image."""
        del details
        return None

    @abstractmethod
    def touch(self, state: Any, frame: FrameTime, raw: Float[Array, " n"], hint: Hint) -> tuple[Any, Touch]:
        """What touches in a frame of raw readings (n,), NaN where missing."""

    @abstractmethod
    def locate(
        self, state: Any, frame: FrameTime, context: Context, squeezed_m3: Float[Array, ""]
    ) -> tuple[Any, Evidence]:
        """Where it touches, the chambers having lost so much of their volume [m³]; state: that of `touch`."""


def _no_two(names: tuple[str, ...]) -> tuple[str, ...]:
    twice = {name for name in names if names.count(name) > 1}
    if twice:
        raise wrong_value(f'"{min(twice)}" is named twice')
    return names


Names = Annotated[tuple[str, ...], NotEmpty, AfterValidator(_no_two)]
"""Names of channels, chambers, cables ..., no two alike."""

Gains = Annotated[tuple[PositiveNumber, ...], NotEmpty, BeforeValidator(listed)]
"""What is measured over what there is [-]: one value for all, or one for each."""


class SensorSettings(Settings):
    """A [[sensor]]: its name, by which reports call it, and the columns of a recording in which it writes.

    What it may measure is in `Parts`; a sensor that does not go with them raises ConfigError.
    """

    channels_for: ClassVar[tuple[int, str] | None] = None
    """How many channels every one has, and for what; None where the table says."""
    errs_with_model: ClassVar[bool] = False
    """Whether its `model_error` is in the standard deviations that it gives its readings."""

    name: str
    channels: Names

    @model_validator(mode="after")
    def _check_channels(self) -> Self:
        if self.channels_for is not None:
            self._count(*self.channels_for)
        return self

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that a recording must have for it, in the order of its raw readings."""
        return self.channels

    @property
    def quantities(self) -> tuple[str, ...] | None:
        """What each reading is, "volume" or "pressure" of a chamber or "shortening" of a cable; () of a
        sensor that sees contacts, None of any other.
        """
        return None

    @abstractmethod
    def sensor(self, parts: "Parts") -> AbstractSensor | AbstractContactSensor:
        """The filter."""

    @abstractmethod
    def functional(self, parts: "Parts") -> "AbstractReading | None":
        """What it measures of an equilibrium; None for one that sees contacts."""

    @property
    def averaged_s(self) -> float:
        """Time constant [s] of the exponential mean that its readings are, its `average`; 0 of none."""
        return getattr(self, "average", 0.0)

    @property
    def places(self) -> tuple[SeenPlace, ...]:
        """The named places where it sees contacts, none where these may be anywhere."""
        return ()

    @property
    def slacks(self) -> Mapping[str, float]:
        """The cables whose zero, what it reads where they get taut, presses may tell, and how much shorter
        [m] each is before it drives the body.
        """
        return {}

    def zeros_after(self, shift: Mapping[str, float]) -> Sequence[float]:
        """Its `zero` of each of these cables [m], more by shifts [m] of some by name."""
        del shift
        return ()

    def points(self, parts: "Parts") -> Float[np.ndarray, "m 3"]:
        """Material points (m, 3) m of the body at rest that `signal` wants to be followed."""
        del parts
        return np.zeros((0, 3))

    def signal(
        self, parts: "Parts", contacts: "Sequence[TrueContact]", moved: Float[np.ndarray, "m 3"]
    ) -> Float[np.ndarray, " k"]:
        """What of the contacts that it sees reaches its electronics (k,), in its own units, in an
        equilibrium.

        `moved` (m, 3) m: where the `points` are then.
        """
        del parts, contacts, moved
        return np.zeros(0)

    @abstractmethod
    def ideal(
        self, parts: "Parts", time_s: Float[np.ndarray, " m"], values: Float[np.ndarray, "m k"]
    ) -> Float[np.ndarray, "m n"]:
        """Raw readings (m, n) of nominal parts without noise at times (m,) [s].

        `values` (m, k): true readings [SI], or, of a sensor that sees contacts, what `signal` says of them.
        """

    @abstractmethod
    def electronics(self, parts: "Parts", rng: np.random.Generator) -> ChannelElectronics:
        """What real parts, drawn from a generator, make of n ideal readings: gain, zero, drift, noise,
        converter.
        """

    def simulate(
        self,
        parts: "Parts",
        time_s: Float[np.ndarray, " m"],
        values: Float[np.ndarray, "m k"],
        made: Sequence[int],
        read: Sequence[int],
    ) -> Float[np.ndarray, "m n"]:
        """Raw readings (m, n) at increasing times (m,) [s] of real parts that one seed decides about, with
        the noise of another.
        """
        drawn, noise = (np.random.default_rng(np.random.SeedSequence(list(seed))) for seed in (made, read))
        ideal = self.ideal(parts, time_s, values)
        return Converter(self.electronics(parts, drawn), noise).read(time_s, ideal)

    def _count(self, count: int, what: str) -> None:
        """Raise the error of a validator unless there are so many channels."""
        if len(self.channels) != count:
            raise wrong_value(f"{len(self.channels)} for {what}", key="channels")

    def _one_each(self, key: str, values: Sequence[object], count: int) -> None:
        """Raise the error of a validator unless there is one value, or one for each of so many."""
        if len(values) not in (1, count):
            raise wrong_value(
                f"{len(values)} values for {count} channels: give one, or one for each", key=key
            )

    def _wrong(self, message: str) -> ConfigError:
        return ConfigError(f'sensor "{self.name}": {message}')


class ContactSettings(SensorSettings):
    """A [[sensor]] that sees the contacts of a [[contact]], with its name."""

    contact: str

    @property
    def quantities(self):
        """None."""
        return ()

    def functional(self, parts):
        """None."""
        return None

    def _chart(self, parts: "Parts") -> FlatChart:
        """The coordinates of the flat face on which it presses; ConfigError where it presses on none."""
        chart = parts.contact_of(self.name, self.contact).chart
        if chart is None:
            raise self._wrong(f'contact "{self.contact}" presses on no flat face, as it needs')
        return chart
