"""One sample does not hold up, or fail, the others that are solved with it."""

from __future__ import annotations

import pytest
import torch

from expertaug.errors import SolveError
from expertaug.inference.posterior_predictive import forecasts
from expertaug.learning.divergence import solve_with_sample_fallback
from expertaug.models.decoder import Decoder
from expertaug.systems.base import Parameter, System
from expertaug.systems.solvers.solver import Solver

T = torch.linspace(0, 0.5, 6)


class Oscillator(System):
    """y'' = −ω² y."""

    state = (Parameter("y"), Parameter("v"))
    expert_parameters = (Parameter("w"),)

    def __init__(self) -> None:
        self.work = 0

    def expert(self, t, y, z_e):
        self.work += y[..., 0].numel()
        return torch.cat((y[..., 1:], -z_e.square() * y[..., :1]), dim=-1)


def oscillators(count=100, fast=()):
    w = torch.linspace(1, 2, count)
    for place, value in fast:
        w[place] = value
    return torch.tensor([1.0, 0.0]).expand(1, count, 2), w.view(1, count, 1)


def solve(system, y0, w, bound=None, method="dopri5"):
    decoder = Decoder(system)

    def predicted(part, solver):
        return decoder.forecast(y0[:, part], w[:, part], w[:, part, :0], T, solver)

    return solve_with_sample_fallback(predicted, y0.shape[1], Solver(method, 1e-6, 1e-6), bound)


def work(*arguments, **options):
    system = Oscillator()
    solve(system, *arguments, **options)
    return system.work


def test_samples_alike_are_solved_together():
    y0, w = oscillators()
    decoder = Decoder(Oscillator())
    together = decoder.forecast(y0, w, w[..., :0], T, Solver("dopri5", 1e-6, 1e-6))
    states, unsolved = solve(Oscillator(), y0, w)
    assert torch.equal(states, together) and not unsolved.any()


def test_a_fast_one_takes_its_steps_alone():
    y0, w = oscillators(fast=[(37, 100.0)])
    states, unsolved = solve(Oscillator(), y0, w)
    assert not unsolved.any() and states.shape == (6, 1, 100, 2)
    slow = w[0, :, 0] < 3
    expected = torch.cos(w[0, slow, 0] * T.unsqueeze(1))
    torch.testing.assert_close(states[:, 0, slow, 0], expected, atol=1e-4, rtol=0)
    system = Oscillator()
    Decoder(system).forecast(y0, w, w[..., :0], T, Solver("dopri5", 1e-6, 1e-6))
    assert work(y0, w) < 0.4 * system.work, "a piece of the batch goes with it"


@pytest.mark.slow
def test_where_all_are_fast_few_are_solved_twice():
    y0, w = oscillators(fast=[(slice(None), 100.0)])
    system = Oscillator()
    Decoder(system).forecast(y0, w, w[..., :0], T, Solver("dopri5", 1e-6, 1e-6))
    assert work(y0, w) < 1.2 * system.work


def test_each_piece_has_its_own_bounds():
    y0, w = oscillators(fast=[(37, 100.0)])
    bound = torch.full((100, 2), 10.0)
    bound[5] = 0.5  # less than where it starts
    states, _ = solve(Oscillator(), y0, w, bound)
    assert torch.equal(states[:, 0, 5], y0[0, 5].expand(6, 2)), "left where it was"
    assert (states[-1, 0, :5, 0] != 1).all()


def test_one_that_cannot_be_solved_is_taken_on_a_fixed_grid(monkeypatch):
    y0, w = oscillators()
    call = Solver.__call__

    def refusing(self, f, y0, t, *args, **options):
        if self.method == "dopri5" and (f(t[0], y0)[..., 1] == -(w[0, 37, 0] ** 2)).any():
            raise SolveError("dopri5 failed (underflow in dt)")
        return call(self, f, y0, t, *args, **options)

    monkeypatch.setattr(Solver, "__call__", refusing)
    states, unsolved = solve(Oscillator(), y0, w)
    assert unsolved.nonzero().tolist() == [[37]]
    alone = Decoder(Oscillator()).forecast(y0[:, 37:38], w[:, 37:38], w[:, 37:38, :0], T, Solver("rk4"))
    assert torch.equal(states[:, :, 37], alone[:, :, 0])


def test_draws_of_a_window_with_a_fast_one_are_solved_apart():
    """Forecasts (K, T, S, B, *state) are those of each draw by itself."""
    y0, w = oscillators(fast=[(37, 100.0)])
    w = torch.stack((w, 1.1 * w))
    both = y0.expand(2, *y0.shape)
    bound = torch.full((100, 2), 1e4)
    found = forecasts(Decoder(Oscillator()), both, w, w[..., :0], T, Solver("dopri5", 1e-6, 1e-6), bound)
    assert found.shape == (2, 6, 1, 100, 2)
    slow = w[0, 0, :, 0] < 3
    expected = torch.cos(w[:, :, slow, 0].unsqueeze(1) * T.view(1, -1, 1, 1))
    torch.testing.assert_close(found[..., slow, 0], expected, atol=1e-4, rtol=0)


@pytest.mark.parametrize("method", ["rk4", "radau"])
def test_other_methods_have_no_such_limit(method):
    y0, w = oscillators(count=3)
    states, unsolved = solve(Oscillator(), y0, w, method=method)
    torch.testing.assert_close(states[:, 0, :, 0], torch.cos(w[0, :, 0] * T.unsqueeze(1)), atol=1e-3, rtol=0)
    assert not unsolved.any()


def test_one_too_fast_for_its_data_is_given_up():
    """Alone it would take a hundred thousand evaluations for each of the five intervals."""
    y0, w = oscillators(count=20, fast=[(3, 1e5)])
    system = Oscillator()
    states, unsolved = solve(system, y0, w)
    assert unsolved.nonzero().tolist() == [[3]]
    torch.testing.assert_close(states[:, 0, :3, 0], torch.cos(w[0, :3, 0] * T.unsqueeze(1)), atol=1e-4, rtol=0)
    assert system.work < 20 * 1000
