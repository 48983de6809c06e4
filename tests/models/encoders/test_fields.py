"""The encoder of spatial averages: what it tells, invariance, one seed or a group."""

import numpy as np
import pytest
import torch

from cards import card
from expertaug.models.encoders.fields import PART, Moments
from expertaug.models.estimators import Hybrid
from expertaug.systems.reaction_diffusion import ReactionDiffusion
from expertaug.systems.settings import SimulatedData, SimulatedSet
from expertaug.systems.simulate import sample
from expertaug.systems.solvers.solver import Solver
from seen import seen

SYSTEM = {"name": "reaction_diffusion"}
ENCODERS = {
    "moments": {"kind": "moments", "powers": [1, 2], "layers": [7, 6], "latent": 3},
    "conv_two_step": {"kind": "conv_two_step", "powers": [1], "layers": [7], "latent": 3, "filter_channels": [4, 4]},
}
T = (np.arange(6) * 0.1).tolist()


def make(kind, seeds):
    model = {"encoder": ENCODERS[kind], "interaction": {"kind": "polynomial", "degree": 1}}
    description = {"kind": "hybrid", "t": T, "observed": 4, "seeds": seeds, "expert": True, "interaction": True}
    return Hybrid.network(ReactionDiffusion(), card(description | {"system": SYSTEM, "model": model}))


def fields(seeds, samples=5):
    y = torch.rand(6, 1, samples, 2, 32, 32, generator=torch.Generator().manual_seed(1))
    return y.expand(-1, seeds, -1, -1, -1, -1)


@pytest.mark.parametrize("kind", ENCODERS)
def test_a_block_computes_what_each_seed_does_alone(kind):
    y = fields(2)
    group = make(kind, [3, 4])
    group.fit(seen(y[:4, 0]))
    for k, seed in enumerate([3, 4]):
        alone = make(kind, [seed])
        alone.fit(seen(y[:4, 0]))
        for together, own in zip(group.encode(seen(y[:4])).mean, alone.encode(seen(y[:4, :1])).mean, strict=True):
            torch.testing.assert_close(together[k], own[0], rtol=1e-4, atol=1e-5)


def test_moments_do_not_change_when_fields_are_shifted_and_are_standardised():
    moments = Moments(ReactionDiffusion(), 4)
    y = fields(1, 40)[:4, 0].movedim(0, 1)
    moments.fit(y)
    found = moments(y)
    torch.testing.assert_close(found.mean(0), torch.zeros(moments.outputs), rtol=0, atol=1e-3)
    torch.testing.assert_close(found.std(0), torch.ones(moments.outputs), rtol=1e-3, atol=0)
    torch.testing.assert_close(moments(y.roll((3, -5), (-2, -1))), found, rtol=1e-3, atol=1e-3)


@pytest.mark.slow
def test_moments_tell_the_diffusion_coefficients():
    ranges = SimulatedSet(size=300, z_e={"a": (0.001, 0.002), "b": (0.003, 0.007)}, z_a={"k": (0.003, 0.005)})
    data = SimulatedData(seed=0, step_s=0.1, t2_s=1.0, noise=0.0, sets={"train": ranges})
    drawn = sample(ReactionDiffusion(), data, "train")
    y, z_e = torch.from_numpy(drawn.y).float(), torch.from_numpy(drawn.z_e).double()
    moments = Moments(ReactionDiffusion(), 11, powers=(1,))
    moments.fit(y[:200])
    x = torch.cat((moments(y), torch.ones(300, 1)), dim=1).double()
    weight = torch.linalg.solve(x[:200].T @ x[:200] + 1e-2 * torch.eye(x.shape[1]), x[:200].T @ z_e[:200])
    error = ((x[200:] @ weight - z_e[200:]).abs() / z_e[200:]).mean(0)
    assert (error < 0.02).all(), error


@pytest.mark.parametrize("kind", ENCODERS)
def test_gradient_reaches_every_parameter(kind):
    model = make(kind, [0, 1])
    y = fields(2)
    posterior = model.encode(seen(y[:4]))
    loss = sum(part.square().sum() for part in posterior.mean)
    loss.backward()
    for name, parameter in model.encoder.named_parameters():
        assert parameter.grad is not None and parameter.grad.abs().sum() > 0, name
    assert torch.isfinite(model.predict(seen(y[:4], torch.tensor(T)), Solver("rk4"))[0]).all()


def test_many_windows_are_taken_in_parts_to_the_same_bits():
    moments = Moments(ReactionDiffusion(), 4)
    frames = torch.rand(2, PART + 3, 4, *ReactionDiffusion().state_shape, generator=torch.Generator().manual_seed(0))
    moments.fit(frames[0])
    with torch.no_grad():
        parts = moments(frames)
    assert torch.equal(parts, moments(frames.requires_grad_()))
