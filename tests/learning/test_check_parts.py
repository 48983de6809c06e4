"""What is wrong with an encoder, an interaction model or an objective is one line, before a training."""

from dataclasses import replace
from functools import partial

import pytest
import torch
from torch import nn

import plain_parts as parts
from expertaug.errors import InputError
from expertaug.learning.check_parts import check_parts
from expertaug.learning.hvae import HybridVAE
from expertaug.learning.objectives import Aphynity
from expertaug.learning.training_data import Task
from expertaug.models.hybrid import HybridModel
from expertaug.models.posterior import Delta, Posterior
from expertaug.presets import resolve
from expertaug.systems.advection_diffusion import AdvectionDiffusion
from expertaug.systems.rlc import RLC
from expertaug.systems.solvers.solver import Solver
from expertaug.systems.wave import DampedWave
from field_systems import Fisher

SYSTEM = RLC()
TASK = Task(torch.arange(8) * 0.1, 5, 5, Solver("rk4"))
CHOICES = resolve("corrected")
WINDOW = {"kind": "window", "windows": {"U": [0, 0.4], "I": [0, 0.4]}, "layers": [6], "latent": 2}


def check(encoder=parts.LinearEncoder, interaction=parts.LinearInteraction, objective=Aphynity, **options):
    check_parts(HybridModel(SYSTEM, encoder, interaction), TASK, lambda seeds: objective(seeds, CHOICES, **options))


@pytest.mark.parametrize(
    ("encoder", "interaction"),
    [
        (parts.LinearEncoder, parts.LinearInteraction),
        (parts.GRUEncoder, parts.SpectralInteraction),
        (partial(parts.KeywordEncoder, gain=2.0), parts.OwnInteraction),
        (parts.GaussianEncoder, {"kind": "polynomial"}),
        (parts.InheritedEncoder, None),
        (WINDOW, {"kind": "damping"}),
        ({"kind": "recurrent", "hidden": 4, "layers": [4]}, {"kind": "mlp", "layers": [4]}),
    ],
)
def test_good_parts_pass(encoder, interaction):
    check(encoder, interaction)


def test_fields_and_the_hybrid_vae_pass():
    two_step = {"kind": "two_step", "latent_layers": [4], "filter_layers": [4], "expert_layers": [4]}
    check(two_step, {"kind": "mlp", "layers": [4]}, HybridVAE, prior={"L": [1.0, 5.0], "C": [0.5, 2.5]})
    fisher = Fisher()
    check_parts(HybridModel(fisher, {"kind": "moments", "layers": [8]}, {"kind": "polynomial"}), TASK)


WAVE, LINE = DampedWave(cells=16), AdvectionDiffusion()
CONV = {"kind": "conv", "channels": [4, 4], "strides": [1, 2], "layers": [6], "latent": 2}
CONV_TWO_STEP = {"kind": "conv_two_step", "channels": [4], "strides": [2], "layers": [6], "filter_channels": [4, 4]}
MLP_TWO_STEP = {"kind": "two_step", "latent_layers": [4], "filter_layers": [4], "expert_layers": [4]}
RECURRENT = {"kind": "recurrent", "hidden": 4, "layers": [4]}


@pytest.mark.parametrize(
    ("system", "encoder", "interaction"),
    [
        (WAVE, CONV, {"kind": "conv", "channels": [4], "kernels": [3, 1]}),
        (WAVE, {"kind": "moments", "layers": [6]}, {"kind": "polynomial", "components": ["w_t"], "reads": ["w_t"]}),
        (WAVE, CONV_TWO_STEP, {"kind": "damping", "components": ["w_t"]}),
        (LINE, CONV, {"kind": "conv", "channels": [4], "kernels": [3, 1]}),
        (LINE, {"kind": "moments", "layers": [6]}, {"kind": "polynomial"}),
        (LINE, CONV_TWO_STEP, {"kind": "damping"}),
        (LINE, RECURRENT, {"kind": "mlp", "layers": [4]}),
        (LINE, MLP_TWO_STEP, {"kind": "mlp", "layers": [4], "reads": ["u"]}),
    ],
)
def test_fields_that_do_not_wrap_around_pass_every_kind(system, encoder, interaction):
    task = replace(TASK, t=TASK.t * 0.01)
    recipe = HybridModel(system, encoder, interaction)
    hybrid_vae = encoder in (CONV_TWO_STEP, MLP_TWO_STEP)
    options = {"prior": {p.name: [0.5 * p.scale, 2 * p.scale] for p in recipe.system.expert_parameters}}
    objective, options = (HybridVAE, options) if hybrid_vae else (Aphynity, {})
    check_parts(recipe, task, lambda seeds: objective(seeds, CHOICES, **options))


class FromSeed(parts.LinearInteraction):
    """Draws a constant that is no buffer."""

    def __init__(self, system, latent):
        super().__init__(system, latent)
        self.mask = torch.rand(2)

    def forward(self, y, z_a):
        return self.mask * super().forward(y, z_a)


class Forgetful(parts.LinearEncoder):
    """fit keeps what it learns where no file sees it."""

    size = 1.0

    def fit(self, observed):
        self.size = float(observed.std())

    def forward(self, observed):
        z_e, z_a = super().forward(observed / self.size)
        return z_e, z_a


class Failing(parts.LinearEncoder):
    def forward(self, observed):
        return self.trunk(observed)


class NaN(parts.LinearInteraction):
    def forward(self, y, z_a):
        return super().forward(y, z_a) / 0 * 0


class Double(parts.LinearInteraction):
    def forward(self, y, z_a):
        return super().forward(y, z_a).double()


class Negative(parts.LinearEncoder):
    def forward(self, observed):
        z_e, z_a = super().forward(observed)
        return Posterior(Delta(-z_e.abs()), Delta(z_a))


class BadFit(parts.LinearEncoder):
    def fit(self, observed):
        raise KeyError("scale")


class OwnLoss(Aphynity):
    """Gives what it is made with."""

    def __init__(self, seeds, choices, give):
        super().__init__(seeds, choices)
        self.give = give

    def loss(self, model, batch, task):
        loss, found = super().loss(model, batch, task)
        return self.give(loss, found)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ({"encoder": parts.FlatEncoder}, r"FlatEncoder gives z_e of shape"),
        ({"encoder": parts.DropoutEncoder}, r"DropoutEncoder draws random numbers"),
        ({"encoder": Failing}, r"Failing fails \(RuntimeError"),
        ({"encoder": Negative}, r"Negative gives a positive parameter a value that is not"),
        ({"encoder": BadFit}, r"fit of BadFit fails \(KeyError"),
        ({"encoder": Forgetful}, r"Forgetful is another after it was saved and loaded; register_buffer"),
        ({"interaction": parts.WrongShape}, r"WrongShape gives shape"),
        ({"interaction": FromSeed}, r"FromSeed gives a seed other values in a group than alone; keep what differs"),
        ({"interaction": NaN}, r"NaN's rates: a value is not finite"),
        ({"interaction": Double}, r"Double's rates: torch\.float64; compute in float32"),
        ({"interaction": {"kind": "mlp", "width": 3}}, r"model\.interaction\.width: unknown to mlp"),
        (
            {"objective": parts.ScalarLoss},
            r"the loss of ScalarLoss has shape \(\); give one number for each seed, \(2,\)",
        ),
        ({"objective": OwnLoss, "give": lambda loss, found: loss}, r"OwnLoss\.loss gives Tensor; return the loss and"),
        ({"objective": OwnLoss, "give": lambda loss, found: (loss, {})}, r"no part called loss"),
        ({"objective": OwnLoss, "give": lambda loss, found: (loss.detach(), found)}, r"OwnLoss\.loss has no gradient"),
        (
            {"objective": OwnLoss, "give": lambda loss, found: (loss / 0, found)},
            r"OwnLoss\.loss: its loss is not finite",
        ),
        ({"objective": OwnLoss, "give": lambda loss, found: (loss, found | {"x": 1.0})}, r"no \(2,\) tensor for x"),
    ],
)
def test_each_mistake_is_one_line(arguments, expected):
    with pytest.raises(InputError, match=expected) as caught:
        check(**arguments)
    assert "\n" not in str(caught.value)


def test_a_step_that_changes_nothing_is_told():
    class Constant(nn.Module):
        def __init__(self, system):
            super().__init__()
            self.size = len(system.expert_parameters)
            self.unused = nn.Parameter(torch.ones(()))

        def forward(self, observed):
            return observed.new_zeros(observed.shape[1], self.size) * self.unused

    def frozen(loss, found):
        return 0 * loss, found

    with pytest.raises(InputError, match="a step of OwnLoss changes no parameter"):
        check_parts(HybridModel(SYSTEM, Constant), TASK, lambda seeds: OwnLoss(seeds, CHOICES, frozen))
