"""Choice between experts: the right one of three is found, and what windows cannot tell is said."""

from dataclasses import replace

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.api.compare import compare
from expertaug.errors import InputError
from expertaug.inference.diagnostics.goodness import Candidate, choose, goodness_of_fit
from expertaug.systems import Parameter, System
from nightly import others_slow

T = np.arange(31) * 0.1
RANGES = {"free": {"omega0": (1.0, 3.5)}, "linear": {"omega0": (1.0, 3.5)}}
RANGES["rubbed"] = {"omega0": (1.0, 3.5), "alpha": (0.01, 1.0)}


class Free(System):
    """θ'' = −ω0² sin θ."""

    state = (Parameter("theta", "rad"), Parameter("omega", "rad/s"))
    expert_parameters = (Parameter("omega0", "rad/s", scale=2.0),)

    def expert(self, t, y, z_e):
        return torch.stack((y[..., 1], -(z_e[..., 0] ** 2) * torch.sin(y[..., 0])), dim=-1)


class Linear(Free):
    """θ'' = −ω0² θ."""

    def expert(self, t, y, z_e):
        return torch.stack((y[..., 1], -(z_e[..., 0] ** 2) * y[..., 0]), dim=-1)


class Rubbed(Free):
    """θ'' = −ω0² sin θ − α θ'."""

    expert_parameters = (*Free.expert_parameters, Parameter("alpha", "1/s", scale=0.3))

    def expert(self, t, y, z_e):
        drag = z_e[..., 1] * y[..., 1]
        return super().expert(t, y, z_e) - torch.stack((torch.zeros_like(drag), drag), dim=-1)


EXPERTS = {"free": Free(), "linear": Linear(), "rubbed": Rubbed()}
HOW = {"starts": 12, "tries": 2}


def swings(alpha, n=12, seed=0, noise=0.02):
    return ea.simulate(
        ea.DampedPendulum(), {"omega0": (1.5, 3.1)}, {"alpha": (alpha, alpha)}, n=n, t=T, noise=noise, seed=seed
    )


@pytest.mark.parametrize(("alpha", "right"), others_slow([(0.4, "rubbed"), (0.0, "free")]))
def test_the_right_one_of_three_is_found(alpha, right):
    found = compare(EXPERTS, swings(alpha), observed_s=3.0, noise=0.02, priors=RANGES, **HOW)
    assert found.chosen == right
    assert right in found.says
    assert found.choice.goodness[right].explains
    assert not found.choice.goodness["linear"].explains
    assert set(found.table.index) == set(EXPERTS)


@pytest.mark.slow
def test_what_a_few_noisy_windows_cannot_tell_is_said():
    found = compare(EXPERTS, swings(0.02, n=3, noise=0.3), observed_s=2.0, noise=0.3, priors=RANGES, **HOW)
    assert found.chosen is None
    assert "do not decide between" in found.says


@pytest.mark.slow
def test_all_may_be_wrong():
    data = swings(0.4)
    wrong = ("free", "linear")
    experts, priors = ({k: of[k] for k in wrong} for of in (EXPERTS, RANGES))
    found = compare(experts, data, observed_s=3.0, noise=0.02, priors=priors)
    assert not any(one.explains for one in found.choice.goodness.values())


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"experts": {"free": Free()}}, "two or more"),
        ({"experts": Free()}, "found Free"),
        ({"priors": {"fre": {"omega0": (1.0, 3.5)}}}, r"priors\.fre: is no expert"),
        ({"experts": {"free": Free(), "circuit": ea.RLC()}, "priors": None}, "states differ"),
        ({"noise": 0.0}, "noise: is zero"),
        ({"observed_s": 0.3}, "points lie before"),
    ],
)
def test_what_cannot_be_compared(change, says):
    asked = {"experts": EXPERTS, "observed_s": 3.0, "noise": 0.02, "priors": RANGES} | change
    with pytest.raises(InputError, match=says):
        compare(asked.pop("experts"), swings(0.1, n=2), **asked)


def test_chi2_of_the_right_model_is_seldom_held_against_it():
    random = np.random.default_rng(0)
    verdicts = [goodness_of_fit(random.chisquare(80, 20) / 80, 80).explains for _ in range(1000)]
    assert np.mean(verdicts) > 0.98
    assert not goodness_of_fit(random.chisquare(80, 20) / 80 * 1.3, 80).explains
    p = goodness_of_fit(random.chisquare(80, 4000) / 80, 80).p
    assert abs(np.mean(p < 0.05) - 0.05) < 0.015


def test_windows_of_one_recording_count_as_one():
    random = np.random.default_rng(1)
    worse = np.repeat(random.normal(0.3, 1.0, 6), 50)  # six recordings, one of them like the other
    chi2 = np.ones(300)
    seen = np.full(300, 80)
    pair = {"a": Candidate(np.ones(300), chi2, seen, 3), "b": Candidate(np.exp(worse), chi2, seen, 3)}
    assert choose(pair).chosen is not None
    assert choose(pair, np.repeat(np.arange(6), 50)).chosen is None


def test_overlapping_windows_do_not_decide_by_their_number():
    """A criterion that hardly differs a window is not decisive because windows of one stretch are many."""
    seen, chi2 = np.full(300, 80), np.ones(300)
    pair = {"a": Candidate(np.ones(300), chi2, seen, 3), "b": Candidate(np.ones(300), chi2 + 0.002, seen, 3)}
    assert choose(pair).chosen == "a"
    assert choose(pair, np.repeat(np.arange(6), 50)).chosen is None


@pytest.mark.slow
def test_what_was_not_measured_does_not_count():
    data = swings(0.4, n=8)
    mask = np.random.default_rng(0).random(data.y.shape) > 0.3
    mask[:, 0] = True
    gaps = replace(data, y=np.where(mask, data.y, 0).astype(np.float32), mask=mask)
    ranges = {"theta": (-2.0, 2.0), "omega": (-6.0, 6.0)}
    found = compare(EXPERTS, gaps, observed_s=3.0, noise=0.02, priors=RANGES, start=ranges, **HOW)
    assert found.chosen == "rubbed" and found.choice.goodness["rubbed"].explains
    assert 0.8 < found.choice.goodness["rubbed"].chi2 < 1.2
