"""What is wrong with a system is one line that names the class, the method and the remedy."""

import numpy as np
import pytest
import torch

from expertaug import systems
from expertaug.errors import InputError
from expertaug.systems import Parameter, System
from expertaug.systems.check_system import check_system
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.solvers.solver import Solver

CONSTANTS = {"B1": 0.103, "G1": 69.4, "B2": 1.35, "G2": 93.5}


class Decay(System):
    """y' = −k y, and a hidden −c y²."""

    state = (Parameter("y"),)
    expert_parameters = (Parameter("k", "1/s"),)
    interaction_parameters = (Parameter("c"),)

    def expert(self, t, y, z_e):
        return -z_e * y

    def truth(self, t, y, z_e, z_a):
        return self.expert(t, y, z_e) - z_a * y**2

    def sample_initial_state(self, n, generator):
        return torch.rand(n, 1, generator=generator, dtype=torch.float64)


@pytest.mark.parametrize(
    "settings",
    [
        {"name": "pendulum"},
        {"name": "rlc"},
        {"name": "reaction_diffusion"},
        {"name": "reaction_diffusion", "reaction": "without_k"},
        {"name": "field_systems:Fisher"},
    ],
)
def test_every_simulated_system_passes(settings):
    check_system(systems.load(settings), solver=Solver("lawson4"))


def test_a_recorded_system_passes():
    check_system(DoublePendulum(constants=CONSTANTS), simulated=False)


def test_ranges_that_fit_pass():
    check_system(Decay(), z_e={"k": [0.1, 2.0]}, z_a={"c": [0.0, 1.0]})


def made(**methods) -> System:
    return type("Wrong", (Decay,), methods)()


unseeded = {"sample_initial_state": lambda self, n, generator: torch.rand(n, 1, dtype=torch.float64)}
MISTAKES = [
    ({"state": ("y",)}, r"Wrong\.state is tuple \('y',\); give a tuple of Parameter"),
    ({"state": (Parameter("y"), Parameter("y"))}, r"Wrong\.state names y, y; every name once"),
    ({"expert_parameters": (Parameter("k", scale=0.0),)}, r"k has the scale 0\.0"),
    ({"state_shape": (2, 4)}, r"state_shape is \(2, 4\) and state has 1 components"),
    ({"truth": System.truth}, r"Wrong does not define truth; simulated data need it"),
    (
        {"truth": lambda self, t, y, z_e, z_a: y[..., 0]},
        r"sys\.yaml: Wrong\.truth gives shape \(3,\); give \(3, 1\): \(samples, \*state\)",
    ),
    ({"truth": lambda self, t, y, z_e, z_a: y.float()}, r"Wrong\.truth gives torch\.float32 for torch\.float64"),
    ({"expert": lambda self, t, y, z_e: (-z_e * y).numpy()}, r"Wrong\.expert gives ndarray; give a torch tensor"),
    ({"expert": lambda self, t, y, z_e: -z_e * y.sum(0)}, r"Wrong\.expert mixes samples; every sample's"),
    (
        {"expert": lambda self, t, y, z_e: -z_e[:, :1] * y},
        r"Wrong\.expert mixes seeds; every",
    ),
    (
        {"expert": lambda self, t, y, z_e: -z_e * y * torch.rand(())},
        r"Wrong\.expert gives other values when called twice",
    ),
    ({"expert": lambda self, t, y, z_e: y / 0}, r"Wrong\.expert gives a value that is not finite"),
    (
        {"expert": lambda self, t, y, z_e: y * torch.ones(1).double()},
        r"Wrong\.expert gives torch\.float64 for torch\.float32",
    ),
    ({"expert": lambda self, t, y, z_e: y.nothing}, r"Wrong\.expert fails \(AttributeError: .*nothing"),
    (
        {"expert": lambda self, t, y, z_e: -z_e.detach() * y},
        r"Wrong\.expert does not depend on z_e, or loses its gradient",
    ),
    (
        {"expert": lambda self, t, y, z_e: -torch.sqrt(z_e - z_e) * y},
        r"Wrong\.expert has a gradient by z_e that is not finite",
    ),
    (
        {"sample_initial_state": lambda self, n, generator: torch.rand(n, generator=generator, dtype=torch.float64)},
        r"Wrong\.sample_initial_state gives shape \(3,\); give \(3, 1\)",
    ),
    (
        {"sample_initial_state": lambda self, n, generator: torch.rand(n, 1, generator=generator)},
        r"Wrong\.sample_initial_state gives torch\.float32 for torch\.float64",
    ),
    ({"sample_initial_state": lambda self, n, generator: np.zeros((n, 1))}, r"sample_initial_state gives ndarray"),
    (unseeded, r"Wrong\.sample_initial_state gives other states for the same generator; draw with generator=generator"),
    ({"kinematics": lambda self, y: y.sum(-1)}, r"Wrong\.kinematics gives shape \(3,\)"),
    ({"observe": lambda self, y: y.sum()}, r"Wrong\.observe gives shape \(\); begin with the samples"),
    ({"features": lambda self, y: y.double()}, r"Wrong\.features gives torch\.float64 for torch\.float32"),
    ({"initial_state": lambda self, y0, z_e: z_e.sum(-1)}, r"Wrong\.initial_state gives shape \(3,\); give \(3, 1\)"),
    (
        {
            "linear_flow": lambda self, z_e, h: lambda y: y * torch.exp(-2 * h * z_e),
            "nonlinear": lambda self, t, y, z_e: 0 * y,
        },
        r"Wrong\.linear_flow and nonlinear do not add up to expert",
    ),
    ({"nonlinear": lambda self, t, y, z_e: 0 * y}, r"Wrong\.linear_flow gives None, and nonlinear leaves a part out"),
]


@pytest.mark.parametrize(("methods", "expected"), MISTAKES)
def test_each_mistake_is_one_line(methods, expected):
    with pytest.raises(InputError, match=expected) as caught:
        check_system(made(**methods), "sys.yaml", solver=Solver("lawson4"))
    assert "\n" not in str(caught.value) and str(caught.value).startswith("sys.yaml: ")


def test_an_axis_of_seeds_is_tried():
    wrong = made(expert=lambda self, t, y, z_e: -torch.stack([z_e[:, 0] * y[:, 0]], dim=1))
    with pytest.raises(
        InputError, match=r"Wrong\.expert gives shape .* for 2 seeds; give \(2, 3, 1\): index components"
    ):
        check_system(wrong)


@pytest.mark.parametrize(
    ("ranges", "expected"),
    [
        (
            {"z_e": {"k": [-1.0, 1.0]}},
            "k of Decay is positive and its range starts at -1; narrow the range, or declare",
        ),
        ({"z_e": {"k": [2.0, 1.0]}}, r"the range of k is \[2\.0, 1\.0\]; min must not exceed max"),
        ({"z_a": {"b": [0.0, 1.0]}}, r"no range for Decay's c; give \[min, max\]"),
    ],
)
def test_ranges_are_checked(ranges, expected):
    with pytest.raises(InputError, match=expected):
        check_system(Decay(), **ranges)
