"""The diagnostics give what the package sbi gives of the same draws (pip install 'expertaug[crosscheck]')."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from gaussian import posterior

from expertaug.inference.diagnostics.calibration import area_to_curve, density_ranks, ranks, tarp_ranks
from expertaug.inference.diagnostics.uniformity import uniformity

sbi_diagnostics = pytest.importorskip("sbi.diagnostics", reason="sbi is not installed")
N, DRAWS = 400, 200
WRONG = {"right": {}, "narrow": {"width": 0.6}, "wide": {"width": 1.7}, "shifted": {"shift": 0.35}}


class Given:
    """What sbi asks of a posterior: the draws made before."""

    def __init__(self, samples: np.ndarray) -> None:
        self.samples = torch.from_numpy(samples)

    def sample_batched(self, shape: torch.Size, x: torch.Tensor, **_: object) -> torch.Tensor:
        assert tuple(shape) == (DRAWS,) and len(x) == N
        return self.samples


@pytest.fixture(params=WRONG, scope="module")
def case(request):
    samples, truth, log_prob = posterior(N, DRAWS, **WRONG[request.param])
    return request.param, samples, truth, log_prob


def sbc(samples, truth, reduce="marginals"):
    x = torch.arange(N, dtype=torch.float64)[:, None]
    options = {"num_posterior_samples": DRAWS, "show_progress_bar": False, "reduce_fns": reduce}
    return sbi_diagnostics.run_sbc(torch.from_numpy(truth), x, Given(samples), **options)


def test_ranks_and_the_verdict_on_them(case):
    name, samples, truth, _ = case
    theirs, dap = sbc(samples, truth)
    ours = ranks(samples, truth)
    np.testing.assert_array_equal(ours, theirs.numpy())
    p_values = uniformity(ours, DRAWS).p_value
    checked = sbi_diagnostics.check_sbc(theirs, torch.from_numpy(truth), dap, num_posterior_samples=DRAWS)
    for p in (p_values, checked["ks_pvals"].numpy()):
        assert (p > 0.01).all() if name == "right" else (p < 0.01).all()


def test_ranks_of_densities(case):
    _, samples, truth, log_prob = case

    def reduce(theta: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
        full = np.broadcast_to(theta.numpy()[:, None], (len(theta), N, 2))
        return torch.from_numpy(log_prob(full)[:, int(x)])

    theirs, _ = sbc(samples, truth, reduce)  # counts what is less likely than the truth
    ours = density_ranks(log_prob(samples), log_prob(truth))
    np.testing.assert_array_equal(DRAWS - ours, theirs.numpy()[:, 0])


def test_tarp(case):
    _, samples, truth, _ = case
    points = np.random.default_rng(0).uniform(truth.min(0), truth.max(0), truth.shape)
    x = torch.arange(N, dtype=torch.float64)[:, None]
    share, level = sbi_diagnostics.run_tarp(
        torch.from_numpy(truth),
        x,
        Given(samples),
        references=torch.from_numpy(points),
        num_posterior_samples=DRAWS,
        show_progress_bar=False,
        num_bins=50,
        z_score_theta=True,
    )
    found = tarp_ranks(samples, truth, references=points)
    # Theirs is a histogram over the ranks that occur; whether an edge belongs to its bin is all that may differ.
    edges = DRAWS * level.numpy()[1:-1]
    up_to = [(found <= edge + side).mean() for side in (-1e-3, 1e-3) for edge in edges]
    before, after = np.reshape(up_to, (2, -1))
    middle = share.numpy()[1:-1]
    assert (before - 1e-6 <= middle).all() and (middle <= after + 1e-6).all()
    area, _ = sbi_diagnostics.check_tarp(share, level)
    assert area_to_curve(found, DRAWS) == pytest.approx(area, abs=0.01)
