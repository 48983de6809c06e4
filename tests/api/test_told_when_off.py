"""What is off about noise, windows and horizons is a line, and misuse is one too."""

from __future__ import annotations

import logging

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.errors import InputError, SolveError
from expertaug.evaluation.estimates import Stated, open_in, summarise
from expertaug.inference.diagnostics.goodness import Candidate, choose, goodness_of_fit

T = np.arange(41) * 0.05
RANGES = {"omega0": (1.0, 4.0)}


@pytest.fixture(scope="module")
def data():
    return ea.simulate(ea.DampedPendulum(), {"omega0": (1.8, 2.2)}, {"alpha": (0, 0)}, n=30, t=T, noise=0.02)


def fitted(data, **options):
    return ea.least_squares(ea.DampedPendulum(), data, observed_s=1.5, prior=RANGES, **options)


def test_noise_of_zero_on_noisy_data_is_told(data, caplog):
    fitted(data)
    assert "the noise is 0, and residuals are about" in caplog.text
    caplog.clear()
    fitted(data, noise=0.02)
    assert "noise is 0" not in caplog.text


@pytest.mark.parametrize(("noise", "told"), [(0.02, False), (0.06, True), (0.022, False)])
def test_noise_that_is_stated_too_large_is_told(noise, told, data, caplog):
    model = fitted(data, noise=noise)
    caplog.clear()
    model.forecast(data.y[:, : model.observed], data.t)
    assert ("the noise is stated about" in caplog.text) == told
    assert "better than their noise allows" in goodness_of_fit(np.full(50, 0.1), 30).says


def test_what_comes_after_the_trainings_times_is_told_of(data, caplog):
    model = fitted(data, noise=0.02).watched(data)
    model.forecast(data.y[:, : model.observed], data.t)
    assert "beyond the" not in caplog.text
    model.forecast(data.y[:, : model.observed], np.r_[data.t, 4.0])
    assert "goes on to 4 s, beyond the 2 s" in caplog.text


@pytest.mark.parametrize("observed_s", [600, 0, -1, float("nan"), "1"])
def test_an_observed_window_that_the_data_do_not_have_is_refused(observed_s, data):
    for call in (
        lambda: ea.least_squares(ea.DampedPendulum(), data, observed_s=observed_s, prior=RANGES),
        lambda: ea.alternate(ea.DampedPendulum(), {"kind": "mlp"}, data, data, observed_s=observed_s, prior=RANGES),
        lambda: ea.compare(
            {"a": ea.DampedPendulum(), "b": ea.DampedPendulum()}, data, observed_s=observed_s, noise=0.02
        ),
    ):
        with pytest.raises(InputError, match="observed_s"):
            call()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a | {"train": np.zeros((3, 41, 2))}, "train: is ndarray"),
        (lambda a: a | {"system": ea.DampedPendulum}, "system: is DampedPendulum; give an instance"),
        (lambda a: a | {"noise": np.array([0.01, 0.01])}, "noise: found array"),
        (lambda a: a | {"prior": {"omega0": (-4, -1)}}, "prior.omega0: found .*positive"),
    ],
)
def test_misuse_is_one_line(change, message, data):
    given = change({"system": ea.DampedPendulum(), "train": data, "noise": 0.02, "prior": RANGES})
    with pytest.raises(InputError, match=message):
        ea.least_squares(given.pop("system"), given.pop("train"), observed_s=1.5, **given)


def test_numpys_numbers_are_a_noise(data):
    assert fitted(data, noise=np.float32(0.02)).refinement.noise == pytest.approx(0.02)


@pytest.mark.parametrize("options", [{}, {"from_s": 100.0}])
def test_nothing_to_score_is_said(options, data):
    model = fitted(data, noise=0.02)
    with pytest.raises(InputError, match="nothing to score"):
        model.evaluate(data.window(0, model.observed) if not options else data, **options)


def test_a_solve_without_an_end_ends(monkeypatch):
    monkeypatch.setattr("expertaug.systems.solvers.solver.MOST_STEPS", 500)
    with pytest.raises(SolveError, match="dopri5 failed"):
        ea.Solver("dopri5")(lambda t, y: 1e5 * torch.cos(1e5 * t) + 0 * y, torch.ones(1, 1), torch.tensor([0.0, 10.0]))


# Means of weak estimates


def weak(truth=0.1, count=60, seed=0):
    """Estimates of a positive parameter whose errors follow them, as those of short windows do."""
    rng = np.random.default_rng(seed)
    values = np.abs(truth + 0.12 * rng.standard_normal(count))
    return Stated(values[None, :, None], (2 * values)[None, :, None], ["alpha"], ["1/s"], None, {}, (), ["alpha"])


@pytest.mark.parametrize("seed", range(5))
def test_a_mean_of_windows_that_leave_a_parameter_open_is_not_told(seed):
    stated = weak(seed=seed)
    assert open_in(stated, {"alpha": (0.0, 1.0)})["alpha"] == 1
    (row,) = summarise(stated, {"alpha": (0.0, 1.0)})
    assert row.told is False and 0.08 < row.value < 0.16 and row.low < 0.1 < row.high


def test_a_mean_of_windows_that_tell_it_is(data):
    rng = np.random.default_rng(0)
    values, errors = 0.1 + 0.01 * rng.standard_normal((1, 60, 1)), np.full((1, 60, 1), 0.01)
    (row,) = summarise(Stated(values, errors, ["alpha"], ["1/s"], None, {}, (), ["alpha"]), {"alpha": (0.0, 1.0)})
    assert row.told is True and row.value == pytest.approx(0.1, abs=0.005)


def test_estimates_warn_of_it(caplog):
    class Damped(ea.DampedPendulum):
        expert_parameters = (*ea.DampedPendulum.expert_parameters, *ea.DampedPendulum.interaction_parameters)
        interaction_parameters = ()

        def expert(self, t, y, z_e):
            return super().expert(t, y, z_e[..., :1]) - z_e[..., 1:] * torch.cat((0 * y[..., :1], y[..., 1:]), -1)

    of_truth = ea.simulate(ea.DampedPendulum(), {"omega0": (2, 2)}, {"alpha": (0.1, 0.1)}, n=40, t=T, noise=0.02)
    data = ea.Trajectories(of_truth.t, of_truth.y, np.full((40, 2), np.nan))
    model = ea.least_squares(Damped(), data, observed_s=0.5, prior=RANGES | {"alpha": (0.01, 0.5)}, noise=0.02)
    caplog.set_level(logging.WARNING)
    table = model.estimates(data).set_index("parameter")
    assert not table.loc["alpha", "told"] and table.loc["omega0", "told"]
    assert "of the windows do not tell alpha by themselves" in caplog.text and "tell omega0" not in caplog.text


# Correlated residuals


def test_a_criterion_of_correlated_residuals_decides_nothing():
    def of(chi2, parameters, overdispersion):
        return Candidate(np.full(8, 1.0), np.full(8, chi2), np.full(8, 60), parameters, overdispersion)

    white = choose({"linear": of(1.3, 2, 1.0), "other": of(1.0, 2, 1.0)})
    correlated = choose({"linear": of(1.3, 2, 19.0), "other": of(1.0, 2, 15.0)})
    assert white.chosen == "other" and correlated.chosen is None
