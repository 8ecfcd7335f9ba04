"""What calibrating a finger needs: contacts of known force on known electrodes, cables of known length."""

import numpy as np

from softfuse.calibration.presses import Applied, Presses
from softfuse.cli.device_calibration import (
    AbstractCalibration,
    Certainty,
    Electrodes,
    Quantity,
    press_numbers,
)
from softfuse.cli.finger_truth import FingerTruth, finger_truth
from softfuse.config.build_tracker import build_senses
from softfuse.estimation.model_error import missed
from softfuse.experiment.contact_accuracy import NOWHERE
from softfuse.hardware.recording import Recording
from softfuse.sensing.finger_senses import FingerSenses

_LIGHT = 0.1
"""Of the largest force, with which a finger is pushed where nothing is known of any."""


class FingerCalibration(AbstractCalibration):
    """Contacts on electrodes squeeze sealed gas, while cables are shortened by what is measured."""

    quantity = Quantity("pressures", "Pa", 1.0)

    columns = (
        "sample (1, 2, ... where all is held), true_force0_N and true_contact0_electrode of each contact"
    )

    def frames(self, recording):
        """Where all is held, the forces are known, and which electrodes they are on."""
        truth = self._truth(recording)
        force, electrode = truth.force_N[truth.samples], truth.electrode[truth.samples]
        there = (electrode >= 0) & (electrode < len(self.settings.electrodes))
        known = np.isfinite(force) & (there | (force <= 0))
        # Of further contacts an empty row says that there are none.
        known[:, 1:] |= ~np.isfinite(force[:, 1:]) & (electrode[:, 1:] == NOWHERE)
        return truth.samples[known.all(axis=1) & (known.shape[1] > 0)]

    def contacts(self, recording):
        """As many as have columns."""
        return max(1, self._truth(recording).force_N.shape[1])

    def senses(self):
        """Without the part of pressures by which the model may be wrong."""
        senses = build_senses(self.settings)
        assert isinstance(senses, FingerSenses)  # its cavities are sealed
        return senses.of_noise_alone()

    def presses(self, recording, at, sensed, contacts):
        """Samples under so many contacts, some of which may press with nothing."""
        truth, cables = self._truth(recording), len(self.settings.cables)
        more = ((0, 0), (0, contacts - truth.force_N.shape[1]))
        # What a force sensor reads below 0 is its noise.
        force = np.pad(np.maximum(np.nan_to_num(truth.force_N[at]), 0.0), more)
        electrode = np.pad(truth.electrode[at], more, constant_values=NOWHERE)
        place = np.where(electrode == NOWHERE, 0, electrode)
        reading, sigma, valid = (
            np.array([getattr(each, name) for each in sensed]) for name in ("reading", "sigma", "valid")
        )
        assert self.settings.gas is not None  # as its cavities are sealed
        filling = np.full((len(at), len(self.settings.cavities)), self.settings.gas.atmosphere)
        prescribed = np.concatenate([reading[:, :cables], filling], axis=1)
        # Where nobody knows by how much a cable is shorter, nothing is known of the shape.
        usable = valid[:, cables:] & valid[:, :cables].all(axis=1, keepdims=True)
        return Presses(
            Applied(place, force, prescribed, press_numbers(recording, at)),
            reading[:, cables:],
            np.where(usable, sigma[:, cables:], np.inf),
        )

    def at(self, applied, press):
        """Its electrodes, and the lengths by which cables are shortened."""
        on = applied.press == press
        names = [
            self.settings.electrodes[place[force > 0][0]].name
            for place, force in zip(applied.place[on].T, applied.force_N[on].T, strict=True)
            if np.any(force > 0)
        ]
        lengths = applied.prescribed[on][:, : len(self.settings.cables)].max(axis=0)
        # Adding 0 takes the sign off a 0.
        cables = np.round(1e3 * lengths, 1) + 0.0
        pulled = [
            f"{cable.name} {length:.1f} mm"
            for cable, length in zip(self.settings.cables, cables, strict=True)
        ]
        return "; ".join([", ".join(names) or "no contact", *pulled])

    def further(self, applied):
        """On each electrode, with the cables as they were, shortest and longest."""
        electrodes, cables = len(self.settings.electrodes), len(self.settings.cables)
        longest = applied.prescribed.max(axis=0)
        pulled = [longest]
        if cables and np.ptp(applied.prescribed[:, :cables]) > 0:
            shortest = np.concatenate([applied.prescribed[:, :cables].min(axis=0), longest[cables:]])
            pulled = [shortest, longest]
        place = np.zeros((electrodes * len(pulled), applied.place.shape[1]), int)
        place[:, 0] = np.tile(np.arange(electrodes), len(pulled))
        force = np.zeros(place.shape)
        force[:, 0] = applied.force_N.max() or _LIGHT * self._most_N
        prescribed = np.repeat(np.array(pulled), electrodes, axis=0)
        return Applied(place, force, prescribed, -1 - np.arange(len(place)))

    def certainty(self, felt, found, further, answer, out):
        """The part of the largest pressure by which modelled ones may be wrong, of all further presses
        together: by what the model misses, and by what is not known of its parameters.
        """
        del felt, further, out
        largest = np.max(np.abs(answer.reading), axis=1)
        unknown = np.einsum("skp,pq,skq->sk", answer.slope, found.covariance, answer.slope)
        wrong = np.mean(missed(answer.reading, found.discrepancy.part) ** 2 + unknown, axis=1)
        part = float(np.sqrt(wrong.sum() / np.sum(largest**2)))
        return Certainty({("sensors", "pressure", "model_error"): float(f"{part:.4g}")}, Electrodes())

    @property
    def _most_N(self) -> float:
        assert self.settings.contact is not None  # it is pushed
        return self.settings.contact.max_force

    def _truth(self, recording: Recording) -> FingerTruth:
        electrodes = [electrode.name for electrode in self.settings.electrodes]
        return finger_truth(recording, [], len(self.settings.cables), electrodes)
