"""What `softfuse evaluate` says of presses: Tables I and II, intervals, Figures 9 to 11 of Navarro et al.
2020.
"""

from collections.abc import Mapping, Sequence
from dataclasses import fields

import numpy as np

from softfuse.experiment.accuracy import Samples, coverage, force_table, location_table, scaled, together
from softfuse.experiment.paper.mutual_bed import MutualBed
from softfuse.experiment.paper.reported import FORCE_ERROR_PERCENT, LOCATION_ERROR_MM
from softfuse.experiment.pose_cache import Arrays
from softfuse.report import figures
from softfuse.report.evaluation import Comparison, Evaluation, Evaluator, Plate
from softfuse.report.mutual_figures import fig_11
from softfuse.report.page import table
from softfuse.report.sections import chamber_outlines
from softfuse.report.study import Study
from softfuse.robot.robot import Robot

_NAMES = [each.name for each in fields(Samples)]


def _said(study: Study) -> Arrays:
    """The samples of a press."""
    samples = study.samples
    assert samples is not None  # the test bed knows
    return {name: getattr(samples, name) for name in _NAMES}


def _evaluation(robot: Robot, found: Mapping[str, Sequence[Arrays]]) -> Evaluation:
    """The evaluation of presses, each estimated in some ways."""
    samples = {way: together([Samples(**each) for each in many]) for way, many in found.items()}
    named = _named(next(iter(samples.values())))
    location = {way: scaled(location_table(each), 1e3) for way, each in samples.items()}
    force = {way: scaled(force_table(each), 100.0) for way, each in samples.items()}
    tables = (
        Comparison("table_1", "Table I: location error", "mm", LOCATION_ERROR_MM, location, named),
        Comparison("table_2", "Table II: force error", "%", FORCE_ERROR_PERCENT, force, named),
    )
    outlines, plates = chamber_outlines(robot), []
    for way, each in samples.items():
        key = way.replace(" ", "_")
        places = np.empty((0, 2))
        plates += [
            Plate(
                f"figure_09_{key}",
                f"Figure 9, {way}: true and estimated locations over the chambers.",
                figures.location_map(places, each, outlines),
            ),
            Plate(
                f"figure_10_{key}",
                f"Figure 10, {way}: estimated over true force, and the force error at the true locations.",
                figures.force_agreement(each),
            ),
        ]
    caption = "Figure 11: what a grid of 4 x 4 mutual capacitances sees of things near and touching."
    plates.append(Plate("figure_11", caption, fig_11(MutualBed())))
    return Evaluation(tables, tuple(plates), (("90 % intervals", _intervals(samples)),), _rows(samples))


def _named(samples: Samples) -> dict[str, str]:
    """What to call the groups of samples: levels by their forces."""
    levels = {
        f"level_{k}": f"{np.mean(samples.true_force_N[samples.level == k]):.3g} N"
        for k in np.unique(samples.level)
    }
    return {"all": "all", "circle": "within 28 mm of the middle"} | levels


def _intervals(samples: Mapping[str, Samples]) -> str:
    inside = {way: coverage(each) for way, each in samples.items()}
    rows = [
        (name, *(f"{100 * part[name]:.0f} %" for part in inside.values())) for name in ("force", "x", "y")
    ]
    return "<p>In so many samples the truth lies within the 90 % interval of the estimate:</p>" + table(
        ("", *inside), rows
    )


def _rows(samples: Mapping[str, Samples]) -> dict[str, dict[str, np.ndarray]]:
    """Columns of a table of all samples, of each way."""
    return {
        way: {
            "level": each.level,
            "true_x_mm": 1e3 * each.true_location_m[:, 0],
            "true_y_mm": 1e3 * each.true_location_m[:, 1],
            "true_force_N": each.true_force_N,
            "x_mm": 1e3 * each.location_m[:, 0],
            "y_mm": 1e3 * each.location_m[:, 1],
            "force_N": each.force_N,
            "x_sigma_mm": 1e3 * each.location_sigma_m[:, 0],
            "y_sigma_mm": 1e3 * each.location_sigma_m[:, 1],
            "force_sigma_N": each.force_sigma_N,
        }
        for way, each in samples.items()
    }


PRESSES = Evaluator(frozenset(_NAMES), _said, _evaluation)
"""Tables I and II, Figures 9 to 11."""
