"""Which forecasts of fitted windows fail is told by the error to be expected of them, where a misfit is blind."""

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.inference.diagnostics.alarm import threshold
from expertaug.models.card import MisfitRecord

T, OBSERVED_S, NOISE = np.arange(81) * 0.1, 3.0, 0.01
RANGES = {"omega0": (1.5, 3.0)}


class Top(ea.DampedPendulum):
    """It begins where it nearly stands on its head, from where small errors grow."""

    def sample_initial_state(self, n, generator):
        theta = np.pi - 0.02 - 0.1 * torch.rand(n, generator=generator, dtype=torch.float64)
        return torch.stack((theta, torch.zeros_like(theta)), -1)


def simulated(system, n, seed):
    return ea.simulate(system, RANGES, {"alpha": (0, 0)}, n=n, t=T, noise=NOISE, seed=seed)


@pytest.fixture(scope="module")
def watched():
    pendulum = ea.DampedPendulum()
    model = ea.least_squares(
        pendulum, simulated(pendulum, 20, 1), observed_s=OBSERVED_S, prior={"omega0": (0.5, 4.0)}, noise=NOISE
    )
    return model.watched(simulated(pendulum, 60, 2))


def test_forecasts_that_are_to_fail_are_not_trusted_although_their_windows_are_explained(watched):
    top, usual = (simulated(system, 40, 3).y[:, : watched.observed] for system in (Top(), ea.DampedPendulum()))
    found = watched.forecast(top, T)
    assert (found.misfit <= threshold(np.array(watched.misfits.validation[0]))).mean() > 0.8
    assert found.trusted.mean() < 0.2
    assert watched.forecast(usual, T).trusted.mean() > 0.8


def test_what_seeds_disagree_on_is_expected_as_well(watched):
    from expertaug.api.trained import judge

    kept = watched.misfits
    record = MisfitRecord.of(validation=kept.validation * 2, expected=kept.expected * 2, between=[0.0] * 60)
    misfit = torch.full((2, 3), min(kept.validation[0]))
    expected = torch.full((2, 3), min(kept.expected[0]))
    assert judge(misfit, record, (expected, torch.zeros(3))).all()
    apart = torch.tensor([0.0, 1.0, 0.0])
    assert judge(misfit, record, (expected, apart)).tolist() == [[True, False, True]] * 2
