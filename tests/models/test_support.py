"""Where a model was learned, and which windows lie outside."""

from __future__ import annotations

import pytest
import torch

from cards import card
from expertaug.models.posterior import Estimates
from expertaug.models.support import outside_support, support_of
from expertaug.systems.pendulum import DampedPendulum

SAID = {"system": {"name": "pendulum"}, "kind": "hybrid", "seeds": [0, 1], "t": [0.0, 1.0], "observed": 1}
PENDULUM = DampedPendulum()


@pytest.fixture
def training():
    """Estimates of 1,000 training windows of two seeds: z_e evenly in [1, 2], z_a evenly in [−1, 1], twice as wide of
    the second seed."""
    even = torch.linspace(0, 1, 1001, dtype=torch.float64)
    z_e = (1 + even).expand(2, -1).unsqueeze(-1)
    z_a = torch.stack((2 * even - 1, 4 * even - 2)).unsqueeze(-1)
    return z_e, z_a


def estimates(z_e: list[float], z_a: list[float]) -> Estimates:
    wide = [torch.tensor(values).expand(2, -1).unsqueeze(-1) for values in (z_e, z_a)]
    return Estimates(torch.zeros(2, len(z_e), 2), *wide)


def test_windows_like_the_trainings_lie_inside_and_others_outside(training):
    model = card(SAID, support=support_of(*training))
    found = outside_support(PENDULUM, model, estimates([1.5, 1.5, 1.5, 0.8, 2.2], [0.0, 1.5, -1.5, 0.0, 0.0]))
    assert found is not None
    assert found.tolist() == [[False, True, True, True, True], [False, False, False, True, True]]
    assert not outside_support(PENDULUM, model, Estimates(torch.zeros(2, 1001, 2), *training)).any()


def test_what_is_no_number_lies_outside(training):
    model = card(SAID, support=support_of(*training))
    assert outside_support(PENDULUM, model, estimates([float("nan")], [0.0])).all()


def test_a_few_training_windows_fitted_wrongly_do_not_widen_the_range(training):
    z_e, z_a = (values.clone() for values in training)
    z_a[:, :4] = 1e6
    model = card(SAID, support=support_of(z_e, z_a))
    assert outside_support(PENDULUM, model, estimates([1.5], [10.0])).all()


@pytest.mark.parametrize(
    "further", [{"augmented_prior": {"omega0": [0.5, 1.9]}}, {"prior": {"omega0": [0.5, 1.9]}}], ids=["p+", "a flow's"]
)
def test_p_plus_is_inside(training, further):
    model = card(SAID, support=support_of(*training), **further)
    assert (
        outside_support(PENDULUM, model, estimates([0.5, 1.95, 0.2], [0.0] * 3)).tolist() == [[False, False, True]] * 2
    )


def test_a_file_without_a_range_says_nothing():
    assert outside_support(PENDULUM, card(SAID), estimates([9.0], [9.0])) is None


def test_a_part_of_a_group_keeps_its_ranges(training):
    model = card(SAID, support=support_of(*training)).of_seeds([1])
    assert model.support.most_z_a == [pytest.approx([1.98])]
