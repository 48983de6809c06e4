"""The minimiser: minima and curvatures that are known, and how it ends."""

from __future__ import annotations

import torch

from expertaug.inference.levenberg_marquardt import minimise


def test_the_minimiser_finds_the_minimum_of_each_problem_and_its_curvature():
    # Rosenbrock's valley, moved to another place for each of 6 problems, beside a linear problem's known curvature.
    place = torch.linspace(0.5, 1.5, 6, dtype=torch.float64)

    def residuals(x, columns):
        a = place[columns]
        return torch.stack((a - x[..., 0], 10 * (x[..., 1] - x[..., 0].square())), -1)

    found = minimise(residuals, torch.full((1, 6, 2), -1.0, dtype=torch.float64), steps=200)
    torch.testing.assert_close(found.x[0, :, 0], place, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(found.x[0, :, 1], place.square(), rtol=1e-3, atol=1e-3)
    jacobian = torch.tensor([[-1.0, 0.0], [-20.0, 10.0]], dtype=torch.float64)  # at x = (1, 1)
    at_one = minimise(lambda x, columns: residuals(x, columns), torch.ones(1, 6, 2, dtype=torch.float64), steps=0)
    torch.testing.assert_close(at_one.curvature[0, 2], jacobian.T @ jacobian, rtol=1e-4, atol=1e-4)


def test_a_candidate_that_runs_away_is_only_very_bad():
    def residuals(x, columns):
        return torch.where(x > 2, torch.nan, x - 1)

    found = minimise(residuals, torch.tensor([[[1.9], [-3.0]]], dtype=torch.float64), steps=60)
    torch.testing.assert_close(found.x[0, :, 0], torch.ones(2, dtype=torch.float64))


def test_a_fit_ends_where_the_next_step_promises_nothing():
    asked = []

    def residuals(x, columns):
        asked.append(columns.shape[-1])
        return torch.stack((x[..., 0] - 0.1, x[..., 1] + 0.2, x.sum(-1) - 0.2), -1)

    minimise(residuals, torch.zeros(1, 4, 2, dtype=torch.float64), steps=30)
    assert asked == [4, 4, 4]  # the start and two steps to a linear problem's minimum, and none to be sure of it


def test_each_seed_goes_on_with_its_own_problems_alone():
    """Where they start near their minima the others are left out, and all end where they would by themselves."""
    place = torch.linspace(0.5, 1.5, 6, dtype=torch.float64).repeat(2, 1)
    asked = []

    def residuals(x, columns):
        asked.append(columns.shape[-1])
        a = place.gather(1, columns)
        return torch.stack((a - x[..., 0], 10 * (x[..., 1] - x[..., 0].square())), -1)

    start = torch.stack((place, place.square()), -1)
    start[0, :2], start[1, 3:5] = -1.0, -1.0
    found = minimise(residuals, start, steps=200)
    assert asked[0] == 6 and set(asked[2:]) <= {1, 2}, "two of each seed, and not the four of either"
    torch.testing.assert_close(found.x[..., 0], place, rtol=1e-4, atol=1e-4)
    assert found.moved.tolist() == [[True, True, *[False] * 4], [*[False] * 3, True, True, False]]
    for seed in range(2):
        own, place = place, place[seed : seed + 1]
        alone = minimise(residuals, start[seed : seed + 1], steps=200)
        place = own
        torch.testing.assert_close(alone.x[0], found.x[seed], rtol=1e-12, atol=1e-12)
