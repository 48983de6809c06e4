"""What is doubtful about fits of windows is said: parameters untold, at their bound, or left where they began."""

import logging

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.models.doubts import FitDoubts

T = np.arange(0, 6.01, 0.1)
OBSERVED = 41


class Spring(ea.System):
    """A mass on a spring: windows tell k/m alone."""

    state = (ea.Parameter("x", "m"), ea.Parameter("v", "m/s"))
    expert_parameters = (ea.Parameter("k", "N/m"), ea.Parameter("m", "kg"))

    def rate(self, y, z_e):
        return -z_e[..., :1] / z_e[..., 1:] * y[..., :1]

    def expert(self, t, y, z_e):
        return torch.cat((y[..., 1:], self.rate(y, z_e)), -1)

    def truth(self, t, y, z_e, z_a):
        return self.expert(t, y, z_e)

    def sample_initial_state(self, n, generator):
        x = torch.rand(n, generator=generator, dtype=torch.float64) + 0.5
        return torch.stack((x, torch.zeros_like(x)), -1)


class Damped(Spring):
    """A rate and a damping, both of which windows tell."""

    expert_parameters = (ea.Parameter("w", "1/s"), ea.Parameter("c", "1/s"))

    def rate(self, y, z_e):
        return -z_e[..., :1].square() * y[..., :1] - z_e[..., 1:] * y[..., 1:]


class Deaf(Damped):
    """Nothing depends on its parameters."""

    def rate(self, y, z_e):
        return -y[..., :1] + 0 * z_e[..., :1]


def forecasts(system, ranges, prior, caplog, fitted=None):
    data = ea.simulate(system, ranges, n=20, t=T, noise=0.01, seed=1)
    model = ea.least_squares(fitted or system, data, observed_s=4.0, prior=prior, noise=0.01)
    with caplog.at_level(logging.WARNING):
        found = model.forecast(data.y[:, :OBSERVED], T)
    return found, [r.getMessage() for r in caplog.records]


def test_a_combination_that_alone_counts_is_named(caplog):
    prior = {"k": (1.0, 8.0), "m": (0.5, 3.0)}
    found, said = forecasts(Spring(), {"k": (2.0, 6.0), "m": (1.0, 2.0)}, prior, caplog)
    assert found.doubts.untold.all() and found.doubts.alone.all() and found.doubts.any.all()
    assert any("do not tell k and m" in line and "only a combination of them" in line for line in said)
    assert found.doubts.reasons(0) == ["the window does not tell k", "the window does not tell m"]
    assert found.table()["doubtful"].all()


def test_parameters_that_windows_tell_are_not_doubted(caplog):
    found, said = forecasts(Damped(), {"w": (1.0, 2.0), "c": (0.1, 0.3)}, {"w": (0.5, 3.0), "c": (0.01, 1.0)}, caplog)
    assert not found.doubts.any.any() and found.doubts.reasons(0) == []
    assert not any("tell" in line or "bound" in line or "start" in line for line in said)


@pytest.mark.slow
def test_a_positive_parameter_at_zero_is_named(caplog):
    class Driven(Damped):
        def rate(self, y, z_e):
            return -z_e[..., :1].square() * y[..., :1] + z_e[..., 1:] * y[..., 1:]

    ranges = {"w": (1.0, 2.0), "c": (0.1, 0.3)}
    found, said = forecasts(Driven(), ranges, {"w": (0.5, 3.0), "c": (0.01, 1.0)}, caplog, Damped())
    assert found.doubts.at_bound[..., 1].double().mean() > 0.8 and not found.doubts.at_bound[..., 0].any()
    assert any("c at its bound, zero" in line for line in said)


def test_fits_that_never_left_their_start_are_told(caplog):
    ranges, prior = {"w": (1.5, 2.0), "c": (0.1, 0.3)}, {"w": (0.5, 3.0), "c": (0.01, 1.0)}
    data = ea.simulate(Damped(), ranges, n=20, t=T, seed=1)
    model = ea.least_squares(Deaf(), data, observed_s=4.0, prior=prior, noise={"x": 0.01, "v": 0.01}, free_start=False)
    with caplog.at_level(logging.WARNING):
        found = model.forecast(data.y[:, :OBSERVED], T)
    assert found.doubts.stuck.all() and found.doubts.any.all()
    assert "20 of 20 fits never left their start" in caplog.text
    assert found.doubts.reasons(3)[0] == "the fit never left its start"


def test_its_share_is_a_metric_of_fits_and_of_nothing_else():
    data = ea.simulate(Spring(), {"k": (2.0, 6.0), "m": (1.0, 2.0)}, n=8, t=T, noise=0.01, seed=1)
    prior = {"k": (1.0, 8.0), "m": (0.5, 3.0)}
    table = ea.least_squares(Spring(), data, observed_s=4.0, prior=prior, noise=0.01).evaluate(data)
    share = table.loc[table["metric"] == "doubtful_share", "value"]
    assert share.tolist() == pytest.approx([1.0])


def test_what_holds_for_half_of_the_seeds_is_said_of_a_window():
    nothing = torch.zeros(2, 2, 1, dtype=torch.bool)
    stuck = torch.tensor([[True, False], [False, False]])
    at_bound = torch.tensor([[[False], [True]], [[False], [True]]])
    found = FitDoubts(("w",), stuck, at_bound, untold=~nothing, alone=nothing)
    assert found.reasons(0) == ["the fit never left its start", "the window does not tell w"]
    assert found.reasons(1) == ["w is at its bound, zero"], "which says more than that it is not told"
    assert found.of_most([1]).stuck.tolist() == [[False, False]] and found.of_most([0, 1]).stuck.tolist() == [
        [True, False]
    ]
