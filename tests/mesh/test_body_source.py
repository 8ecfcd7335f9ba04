"""Bodies in which cavities are designed: their outside and fineness give the mesh that the config has."""

from dataclasses import replace

import numpy as np
import pytest

from softfuse.errors import MeshError
from softfuse.mesh.block import block_mesh, centred_boxes
from softfuse.mesh.body_source import BodySource
from softfuse.mesh.file_source import MeshSource
from softfuse.mesh.finger import FingerSource
from softfuse.mesh.pad import PadSource

PAD = PadSource.model_validate(
    {
        "type": "pad",
        "size": ["40 mm", "30 mm", "18 mm"],
        "cavity_size": ["12 mm", "10 mm", "6 mm"],
        "surface_size": "6 mm",
        "base_size": "9 mm",
        "fine_depth": "2 mm",
    }
)
FINGER = FingerSource.model_validate(
    {
        "type": "finger",
        "size": ["60 mm", "20 mm", "20 mm"],
        "neck_x": ["20 mm", "40 mm"],
        "neck_length": "12 mm",
        "neck_height": "15 mm",
        "cavity_size": ["8 mm", "6 mm", "6 mm"],
        "wall_size": "6 mm",
        "base_size": "9 mm",
    }
)


@pytest.mark.parametrize(
    ("source", "centres"),
    [
        (PAD, [(-0.01, 0.0, 0.009), (0.01, 0.0, 0.009)]),
        (FINGER, [(0.02, 0.005, 0.012), (0.04, -0.005, 0.012)]),
    ],
)
def test_a_design_of_the_cavities_that_there_are_has_the_same_mesh(
    source: PadSource | FingerSource, centres: list[tuple[float, float, float]]
) -> None:
    boxes = centred_boxes(np.array(centres), source.cavity_size)
    outside, fineness = source.outside(), source.fineness(boxes)
    assert not len(outside.cavities)
    made = block_mesh(replace(outside, cavities=boxes), fineness.base_size, fineness.longest)
    own = source.mesh(centres)
    np.testing.assert_array_equal(made.tets, own.tets)
    np.testing.assert_array_equal(made.nodes, own.nodes)


def test_a_block_is_written_as_it_was_read_and_a_beam_with_necks_is_none() -> None:
    written = PAD.as_layout()
    assert written.pop("type") == "layout"
    drawn = {"type": "pad", "cavity_size": ["12 mm", "10 mm", "6 mm"]}
    assert PadSource.model_validate({**drawn, **written}) == PAD
    assert FINGER.as_layout() is None


def test_what_is_read_from_a_file_is_no_block() -> None:
    source: BodySource = MeshSource.model_construct(type="mesh")
    for asked in (source.outside, lambda: source.fineness(np.zeros((1, 2, 3)))):
        with pytest.raises(MeshError, match='designed in a "pad", a "layout" or a "finger"'):
            asked()
