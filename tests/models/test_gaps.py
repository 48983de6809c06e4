"""What stands for values of a window that nobody measured."""

from __future__ import annotations

import math

import pytest
import torch

from expertaug.errors import InputError
from expertaug.models.gaps import Gaps, ends_of, ranges_of
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from seen import seen

TIMES = torch.arange(3, dtype=torch.float64) * 0.1
RANGES = {"theta": (-1.0, 1.0), "omega": (2.0, 4.0)}


def test_ranges_are_those_given_and_else_a_tenth_wider_than_what_was_measured():
    middle, half = ends_of(RANGES)
    assert middle.tolist() == [0.0, 3.0] and half.tolist() == [1.0, 1.0]
    found = ranges_of(["a", "b", "c"], [0.0, 5.0, math.nan], [10.0, 6.0, math.nan], {"b": (-1, 1)})
    assert found == {"b": [-1.0, 1.0], "a": [-1.0, 11.0]}, "nobody measured c"
    with pytest.raises(InputError, match=r"start\.d: 'd' is no component of the state"):
        ranges_of(["a"], [0.0], [1.0], {"d": (0, 1)})


def test_a_gap_is_filled_by_a_straight_line_and_a_component_without_values_by_the_middle_of_its_range():
    y = torch.tensor([[0.5, math.nan], [math.nan, math.nan], [1.5, math.nan]]).unsqueeze(1)
    filled = Gaps(DampedPendulum(), TIMES, RANGES).filled(seen(y)).y
    torch.testing.assert_close(filled[:, 0], torch.tensor([[0.5, 3.0], [1.0, 3.0], [1.5, 3.0]]))


def test_a_first_point_is_as_it_was_measured_and_else_estimated_within_its_range():
    torch.manual_seed(0)
    gaps, y = Gaps(DampedPendulum(), TIMES, RANGES), 3 * torch.randn(3, 50, 2)
    assert torch.equal(gaps.start(seen(y)), y[0])
    y[0, :, 1] = math.nan
    first = gaps.start(seen(y))
    assert torch.equal(first[:, 0], y[0, :, 0]) and first[:, 1].min() >= 2 and first[:, 1].max() <= 4
    assert len(first[:, 1].unique()) > 10, "it depends on the window"


def test_fields_and_components_without_a_range_are_refused():
    with pytest.raises(InputError, match=r"start\.omega: missing"):
        Gaps(DampedPendulum(), TIMES, {"theta": (-1.0, 1.0)})
    with pytest.raises(InputError, match="only vectors may have values that are not measured"):
        Gaps(ReactionDiffusion(), TIMES, {})
