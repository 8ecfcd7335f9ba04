"""A force on an electrode of a device, and its cables shortened or pulled."""

from dataclasses import replace
from typing import Any

import jax.numpy as jnp
import numpy as np

from softfuse.cli.study import known
from softfuse.cli.trial import AbstractTrial, Asked
from softfuse.config.build_device import electrode_places
from softfuse.errors import SoftfuseError
from softfuse.experiment.watched import build_watched
from softfuse.io.quantity import FORCE, LENGTH
from softfuse.mechanics.cable import PulledCable, ShortenedCable
from softfuse.mechanics.load import AbstractLoad


class ElectrodeTrial(AbstractTrial):
    """One electrode pressed, equally on all its patches, while each cable has a length or a tension."""

    def __init__(self, asked: Asked):
        """Raises SoftfuseError for an unknown electrode, a quantity that is none, or other options."""
        if asked.at is not None or asked.contact is not None:
            raise SoftfuseError(
                "this device is pressed at its electrodes, not at any place by a disc: "
                f"give --electrode and one of {_names(asked)}"
            )
        self._asked = asked
        self._electrode = _number_of(asked)
        cables = [load for load in asked.device.actuators if isinstance(load, PulledCable)]
        if len(asked.cables) > len(cables):
            raise SoftfuseError(f"--cable is given {len(asked.cables)} times for {len(cables)} cables")
        given = [_driven(cable, text, asked) for cable, text in zip(cables, asked.cables, strict=False)]
        actuators = (*(load for load, _ in given), *asked.device.actuators[len(given) :])
        self._device = replace(asked.device, actuators=actuators)
        self._watched = build_watched(asked.config, self._device, asked.mesh)
        patches = asked.device.contacts[0].drives
        start = np.asarray(self._device.rest_state(self.places).drive).copy()
        start[:patches] = (asked.force or 0.0) / patches
        start[patches : patches + len(given)] = [value for _, value in given]
        self._drive = jnp.asarray(start)

    @property
    def device(self):
        """With the cables shortened or pulled."""
        return self._device

    @property
    def places(self):
        """The electrode."""
        return jnp.asarray(electrode_places(self._asked.config)[[self._electrode]])

    @property
    def drive(self):
        """Forces of its patches, shortenings or tensions, gas as it was sealed."""
        return self._drive

    def numbers(self, state) -> dict[str, Any]:
        """Force, cables, pressures, points and bending."""
        config, posture = self._asked.config, self._watched.posture(state)
        patches = self._device.contacts[0].drives
        drive = np.asarray(state.drive)[patches:]
        loads, count = self._device.actuators, len(config.cables)
        pulled = [isinstance(load, PulledCable) for load in loads[:count]]
        numbers: dict[str, Any] = {
            "force_N": float(np.sum(state.drive[:patches])),
            "electrode": config.electrodes[self._electrode].name if self._asked.electrode else None,
            "cables": {
                cable.name: {
                    "shortening_mm": 1e3 * float(answer if by_force else given),
                    "tension_N": float(given if by_force else answer),
                }
                for cable, by_force, given, answer in zip(
                    config.cables, pulled, drive[:count], posture.answers[:count], strict=True
                )
            },
            "points_mm": {
                point.name: [1e3 * float(x) for x in place]
                for point, place in zip(config.points, posture.point_m, strict=True)
            },
            "bend_deg": [float(angle) for angle in np.rad2deg(posture.turn)],
            "tip_bend_deg": known(float(np.rad2deg(posture.tip_turn))),
        }
        gas = posture.answers[count:] if config.gas else np.zeros(0)
        return numbers | {"pressures_Pa": [float(p) for p in gas]}

    def told(self, numbers):
        """Line by line."""
        where = f" on {numbers['electrode']}" if numbers["electrode"] else ""
        lines = [
            f"{numbers['force_N']:g} N{where} ({numbers['nodes']} nodes, {numbers['newton_iterations']} "
            "iterations)"
        ]
        for name, cable in numbers["cables"].items():
            lines.append(
                f"cable {name}: {cable['shortening_mm']:.3f} mm shorter, tension {cable['tension_N']:.4f} N"
            )
        for name, place in numbers["points_mm"].items():
            lines.append(f"{name}: ({', '.join(f'{x:.3f}' for x in place)}) mm")
        if numbers["bend_deg"]:
            bent = ", ".join(f"{angle:.2f}" for angle in numbers["bend_deg"])
            lines.append(f"bending from the base to the tip: {bent} deg")
        if numbers["pressures_Pa"]:
            lines.append(f"pressures: {', '.join(f'{p:.1f}' for p in numbers['pressures_Pa'])} Pa")
        return "\n".join(lines)


def _names(asked: Asked) -> str:
    return ", ".join(f'"{electrode.name}"' for electrode in asked.config.electrodes)


def _number_of(asked: Asked) -> int:
    """The electrode that is pressed; the first one without force where none is."""
    names = [electrode.name for electrode in asked.config.electrodes]
    if asked.electrode is None:
        if asked.force:
            raise SoftfuseError(f"--force needs an --electrode: give one of {_names(asked)}")
        return 0
    if asked.force is None:
        raise SoftfuseError("--force is missing: give the force on the electrode in N")
    if asked.electrode not in names:
        raise SoftfuseError(f'there is no electrode "{asked.electrode}": give one of {_names(asked)}')
    return names.index(asked.electrode)


def _driven(cable: PulledCable, text: str, asked: Asked) -> tuple[AbstractLoad, float]:
    """The cable with its shortening [m] or tension [N]."""
    for dimension in (LENGTH, FORCE):
        try:
            value = dimension.parse(text)
        except ValueError:
            continue
        if value < 0:
            break
        load = cable if dimension is FORCE else ShortenedCable.of(cable, asked.device.body)
        return load, value
    raise SoftfuseError(f'--cable "{text}" is no length or force from 0 up: give "10 mm" or "2 N"')
