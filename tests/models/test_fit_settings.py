"""Settings of fits and what they find: constants of seeds, and what windows share."""

from __future__ import annotations

import math

import pytest

from expertaug.models.fit_settings import Constant, Refinement, RefinementSettings


def test_a_constant_of_seeds_is_their_mean_with_an_error_of_both_sources():
    each = [Constant(value=value, std=std, groups=5) for value, std in ((1.0, 0.3), (3.0, 0.4))]
    found = Constant.of_seeds(each)
    assert found.value == 2.0 and found.std == pytest.approx(math.sqrt((0.09 + 0.16) / 2)) and found.groups == 5
    assert found.error == pytest.approx(math.hypot(found.std, 1.0)), "1 is the error of the mean of 1 and 3"
    assert found.held == [1.0, 3.0] and found.at([1]).value == 3.0 and each[0].held == 1.0


def test_what_windows_share_is_told_and_left_out_where_each_is_fitted_alone():
    settings = RefinementSettings.of(
        units={"a": "shared", "b": "trajectory", "c": "window"}, sensors={"x": {"scale": "shared", "offset": "shared"}}
    )
    assert (settings.shared, settings.tied) == (["a"], ["b"])
    assert settings.of_sensors == [("x", "scale"), ("x", "offset")] and settings.holds and settings.shares
    assert not settings.alone.shares and settings.alone.steps == settings.steps
    assert (
        RefinementSettings.of(units={"b": "trajectory"}).shares
        and not RefinementSettings.of(units={"b": "window"}).shares
    )


def test_a_refinement_of_some_seeds_has_what_was_estimated_with_them():
    shared = {"a": Constant(value=2.0, seeds=[1.0, 3.0], std=0.1)}
    whole = Refinement.of(
        settings=RefinementSettings(), noise=0.1, prior=None, shared=shared, overdispersion=[1.5, 2.5]
    )
    second = whole.of_seeds([1])
    assert second.shared["a"].held == [3.0] and second.overdispersion == [2.5] and whole.shared["a"].value == 2.0
