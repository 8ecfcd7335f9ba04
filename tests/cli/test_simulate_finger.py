"""softfuse simulate on a coarse finger."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from softfuse.cli.electrode_trial import ElectrodeTrial
from softfuse.cli.trial import Asked
from softfuse.config import load
from softfuse.config.build_device import build_device, electrode_places
from softfuse.config.build_mesh import build_mesh
from softfuse.mechanics.cable import PulledCable, ShortenedCable
from softfuse.mesh.files import read_mesh

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def coarse(linear_finger: Callable[..., Path]) -> Path:
    """The finger's config on a coarse mesh of elements that compile in no time."""
    return linear_finger()


@pytest.mark.slow
def test_a_push_and_a_pull_give_numbers_and_a_shape(
    code_of: Callable[..., int], tmp_path: Path, coarse: Path
) -> None:
    numbers, shape = tmp_path / "n.json", tmp_path / "s.vtu"
    given = ("--electrode", "tip left", "--force", "0.2", "--cable", "5 mm", "--quiet")
    assert code_of("simulate", coarse, *given, "--json", numbers, "--vtu", shape) == 0
    found = json.loads(numbers.read_text())
    assert found["result"] == "converged" and found["force_N"] == pytest.approx(0.2)
    assert found["electrode"] == "tip left" and len(found["pressures_Pa"]) == 6
    cable = found["cables"]["palm"]
    assert cable["shortening_mm"] == pytest.approx(5.0) and 0.5 < cable["tension_N"] < 5.0
    # Pushed from the left it goes right, and the palm's cable pulls it down.
    x, y, z = found["points_mm"]["p0"]
    assert x < 117.0 and y < -2.0 and z < 0.0
    assert found["tip_bend_deg"] > 10.0 and len(found["bend_deg"]) == 4
    assert len(read_mesh(shape).nodes) == found["nodes"]


def test_a_cable_is_shortened_or_pulled(coarse: Path) -> None:
    config = load(coarse)
    mesh = build_mesh(config)
    device = build_device(config, mesh)
    patches = device.contacts[0].drives
    for text, kind, value in (("5 mm", ShortenedCable, 5e-3), ("2 N", PulledCable, 2.0)):
        trial = ElectrodeTrial(Asked(config, device, mesh, 0.2, None, None, "lower left", [text]))
        assert isinstance(trial.device.actuators[0], kind)
        np.testing.assert_array_equal(trial.places, electrode_places(config)[[4]])
        np.testing.assert_allclose(trial.drive[: patches + 1], [*[0.2 / patches] * patches, value])
        np.testing.assert_allclose(trial.drive[patches + 1 :], 101325.0)
        told = trial.numbers(trial.device.rest_state(trial.places))
        assert told["electrode"] == "lower left" and told["cables"]["palm"]["tension_N"] == 0.0
        np.testing.assert_allclose(told["points_mm"]["p3"], [75, 0, 10], atol=1e-9)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--at", "10,0", "--force", "1"), "pressed at its electrodes, not at any place"),
        (("--electrode", "thumb", "--force", "1"), 'there is no electrode "thumb"'),
        (("--force", "1"), "--force needs an --electrode"),
        (("--electrode", "tip left"), "--force is missing"),
        (("--cable", "10"), '--cable "10" is no length or force'),
        (("--cable", "-1 mm"), '--cable "-1 mm" is no length or force'),
        (("--cable", "1 mm", "--cable", "1 mm"), "--cable is given 2 times for 1 cables"),
    ],
)
def test_a_mistake_is_one_line(
    code_of: Callable[..., int],
    capsys: pytest.CaptureFixture[str],
    coarse: Path,
    arguments: tuple[str, ...],
    told: str,
) -> None:
    assert code_of("simulate", coarse, *arguments) == 2
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == 1


def test_a_pad_has_no_electrodes_to_be_pressed(
    code_of: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert code_of("simulate", ROOT / "configs" / "pad.toml", "--electrode", "tip", "--force", "1") == 2
    assert "this device is pressed by a disc" in capsys.readouterr().err


@pytest.mark.slow
def test_the_cable_bends_the_finger_beyond_a_right_angle(
    code_of: Callable[..., int], tmp_path: Path, coarse: Path
) -> None:
    numbers = tmp_path / "n.json"
    assert code_of("simulate", coarse, "--cable", "25 mm", "--quiet", "--json", numbers) == 0
    found = json.loads(numbers.read_text())
    assert found["result"] == "converged" and found["tip_bend_deg"] > 90.0
    assert found["residual_N"] < 1e-6
