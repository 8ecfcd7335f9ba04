"""What calibrating a pad needs: presses of one disc at known places."""

from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from softfuse.calibration.array_pose import Located, fit_pose
from softfuse.calibration.electrode_baseline import untouched
from softfuse.calibration.electrode_edits import baseline_edits, gain_edits, with_gains
from softfuse.calibration.electrode_gains import GainFit, LineSignals, fit_gains
from softfuse.calibration.grid import Grid
from softfuse.calibration.of_robot import build_pose_prior, pose_edits
from softfuse.calibration.presses import Applied, Presses
from softfuse.cli.device_calibration import (
    AbstractCalibration,
    Certainty,
    Electrodes,
    Felt,
    Quantity,
    press_numbers,
)
from softfuse.cli.recorded import TRUTH, sample_frames
from softfuse.config.build_tracker import build_senses
from softfuse.config.contact import DiscSettings
from softfuse.estimation.reading_spread import write_spread
from softfuse.functional.chart import facing
from softfuse.sensors.pad_senses import PadSenses


@dataclass(frozen=True, eq=False)
class PadCalibration(AbstractCalibration):
    """One disc at a place squeezes air out of cavities; `gains`: of crossed electrodes, once told."""

    quantity = Quantity("volume changes", "mm³", 1e9)

    columns = f"{TRUTH[0]} (1, 2, ... where the force is held), {', '.join(TRUTH[1:-1])} and {TRUTH[-1]}"

    gains: GainFit | None = None

    def frames(self, recording):
        """Where the force is held."""
        return sample_frames(recording)

    def contacts(self, recording):
        """One."""
        del recording
        return 1

    def senses(self):
        """As they are: what a model misses is no part of them."""
        return build_senses(self.settings)

    def presses(self, recording, at, sensed, contacts):
        """Samples under one disc."""
        columns = recording.columns
        place = 1e-3 * np.stack([columns["true_x_mm"][at], columns["true_y_mm"][at], 0.0 * at], axis=1)
        force = columns["true_force_N"][at][:, None]
        # What nothing is felt to touch has read nothing.
        valid = np.array([each.valid & each.touching.any() for each in sensed])
        return Presses(
            Applied(
                self._facing(place)[:, None], force, self._unpulled(len(at)), press_numbers(recording, at)
            ),
            np.array([each.reading for each in sensed]),
            np.where(valid, np.array([each.sigma for each in sensed]), np.inf),
        )

    def sharpened(self, felt):
        """With the gains of crossed electrodes: places that were found without are off by what these are."""
        sigma = self.settings.calibration.electrode_gain
        signals = _signals(felt) if self._crossed and sigma > 0 else None
        if signals is None:
            return None
        senses = self.senses()
        assert isinstance(senses, PadSenses)  # they have lines
        names = [f"{channel} gain" for channel in self._lines]
        gains = fit_gains(
            signals,
            senses.sensors.peak,
            senses.pose,
            names,
            gain_sigma=sigma,
            pose_sigma=build_pose_prior(self.settings).sigma,
        )
        return replace(self, settings=with_gains(self.settings, gains), gains=gains)

    def at(self, applied, press):
        """Its place in mm."""
        x, y = 1e3 * applied.place[applied.press == press][0, 0, 0, :2]
        return f"({x:.1f}, {y:.1f}) mm"

    def further(self, applied):
        """On a grid over the workspace."""
        grid = self._grid(applied)
        count = len(grid.force_N)
        places, number = self._facing(grid.point_m), -1 - np.arange(count)
        return Applied(places[:, None], grid.force_N[:, None], self._unpulled(count), number)

    def places_mm(self, further):
        """Seen from above."""
        return 1e3 * further.place[:, 0, 0, :2]

    def certainty(self, felt, found, further, answer, out):
        """How uncertain readings are over the workspace, as a file; where crossed electrodes lie, how
        strongly they answer and what they read untouched.
        """
        electrodes = self._electrodes(felt, further)
        path = out.with_suffix(".npz")
        spread = self._grid(felt.presses.applied).spread(answer, found.covariance)
        posterior = {name: getattr(found, name) for name in ("value", "covariance", "prior_sigma")}
        write_spread(path, spread, names=np.array(found.names), **posterior)
        edits = {
            **pose_edits(self.settings, electrodes.pose),
            **(gain_edits(self.settings) if self.gains is not None else {}),
            **baseline_edits(self.settings, electrodes.untouched),
            ("estimator", "model_error"): float(f"{found.discrepancy.part:.4g}"),
            ("estimator", "reading_spread"): path.name,
        }
        return Certainty(edits, electrodes)

    def _electrodes(self, felt: Felt, further: Applied) -> Electrodes:
        if not self._crossed:
            return Electrodes()
        located, pose = self._located(felt), None
        if located is not None:
            pose = fit_pose(located, build_pose_prior(self.settings), further.place[:, 0, 0, :2])
        counts, away = list[np.ndarray](), list[np.ndarray]()
        for recording, sensed in felt.recordings:
            counts.append(recording.matrix(self._lines)[: len(sensed)])
            details = (each.details for each in sensed)
            away.append(np.array([seen.electrode_valid & ~(seen.near | seen.felt) for seen in details]))
        return Electrodes(pose, self.gains, untouched(np.concatenate(counts), np.concatenate(away)))

    def _located(self, felt: Felt) -> Located | None:
        """Where crossed electrodes place the samples that they feel; None when they feel none."""
        on, applied, senses = _felt_at(felt), felt.presses.applied, self.senses()
        if not on.any():
            return None
        assert isinstance(senses, PadSenses)  # they have lines
        location = np.array([np.asarray(each.location_m)[0, :2] for each in felt.sensed])[on]
        seen = [each.details for each, felt_it in zip(felt.sensed, on, strict=True) if felt_it]
        dent = np.array([each.dent_m(senses.sensors.peak.radius_m) for each in seen])
        promised = [
            senses.pose.spread(
                each.location_covariance_m2 / each.location_widening, jnp.ones(()), jnp.zeros(())
            )
            for each in seen
        ]
        sigma = np.sqrt(np.diagonal(np.array(promised), axis1=1, axis2=2))
        return Located(applied.place[on, 0, 0, :2], location, sigma, dent, applied.press[on])

    @property
    def _crossed(self) -> bool:
        return self.settings.sensors is not None and self.settings.sensors.crossed is not None

    @property
    def _lines(self) -> list[str]:
        """Columns of the crossed electrodes, rows first."""
        assert self.settings.sensors is not None  # `_crossed` has told
        return list(self.settings.sensors.capacitive.lines)

    def _unpulled(self, samples: int) -> np.ndarray:
        """Cables of a pad are left alone."""
        return np.zeros((samples, len(self.settings.cables)))

    def _facing(self, points: np.ndarray) -> np.ndarray:
        """The places of a disc at points."""
        return facing(points, np.array(self._disc.direction))

    def _grid(self, applied: Applied) -> Grid:
        area = self._disc.workspace
        return Grid.over(area.x, area.y, float(applied.force_N.max()))

    @property
    def _disc(self) -> DiscSettings:
        assert isinstance(self.settings.contact, DiscSettings)  # as a pad is pressed by discs
        return self.settings.contact


def _felt_at(felt: Felt) -> Bool[np.ndarray, " s"]:
    """The samples (s,) that crossed electrodes place, and say how sure they are."""
    known = [
        np.isfinite(np.append(np.asarray(each.location_m)[0, :2], np.asarray(each.location_sigma_m)[0])).all()
        for each in felt.sensed
    ]
    return np.array(known)


def _signals(felt: Felt) -> LineSignals | None:
    """By which signals they do; None when they feel none."""
    on, applied = _felt_at(felt), felt.presses.applied
    if not on.any():
        return None
    signal, told = (
        np.array([np.asarray(getattr(each.details, name)) for each in felt.sensed])[on]
        for name in ("signal_counts", "electrode_valid")
    )
    return LineSignals(applied.place[on, 0, 0, :2], signal, told, applied.press[on])
