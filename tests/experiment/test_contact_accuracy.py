"""Contacts at electrodes against truth that is made by hand."""

import numpy as np
import pytest

from softfuse.experiment.accuracy import (
    NOWHERE,
    ContactSamples,
    contact_force_table,
    largest_force,
)


@pytest.fixture
def samples() -> ContactSamples:
    """Found in another order; one missed; one misplaced; one without a tip; one whose force is not known."""
    return ContactSamples(
        level=np.array([1, 1, 2, 2, 2]),
        electrode=np.array([[11, 4], [4, NOWHERE], [7, 10], [NOWHERE, NOWHERE], [4, NOWHERE]]),
        force_N=np.array([[0.9, 2.2], [1.5, 0.0], [0.3, 0.5], [0.0, 0.0], [np.nan, 0.0]]),
        true_electrode=np.array([[4, 11], [4, 11], [4, 10], [NOWHERE, NOWHERE], [4, 11]]),
        true_force_N=np.array([[2.0, 1.0], [1.0, 0.4], [1.0, 0.5], [0.0, 0.0], [1.0, 0.0]]),
    )


def test_forces_are_compared_at_the_same_electrode(samples: ContactSamples) -> None:
    np.testing.assert_allclose(
        samples.force_error,
        [[0.1, 0.1], [0.5, np.nan], [np.nan, 0.0], [np.nan, np.nan], [np.nan, np.nan]],
        atol=1e-12,
    )


def test_contacts_are_counted_where_something_presses(samples: ContactSamples) -> None:
    assert samples.true.sum() == 7
    assert samples.missed == 2  # in the second and the third sample
    assert samples.misplaced == 1  # on electrode 7


def test_the_table_groups_by_contact_and_by_level(samples: ContactSamples) -> None:
    found = contact_force_table(samples)
    assert list(found) == ["all", "contact0", "contact1", "level_1", "level_2"]
    assert {name: spread.n for name, spread in found.items()} == {
        "all": 4,
        "contact0": 2,
        "contact1": 2,
        "level_1": 3,
        "level_2": 1,
    }
    assert found["all"].mean == pytest.approx(0.175) and found["contact0"].mean == pytest.approx(0.3)


def test_the_largest_force_is_that_of_the_frames_that_count() -> None:
    force = np.array([0.2, np.nan, 0.7, 3.0])
    assert largest_force(force, np.array([True, True, True, False])) == 0.7
    assert np.isnan(largest_force(force, np.array([False, True, False, False])))
