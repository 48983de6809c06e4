"""The gradient of a solve without a graph of its steps is that of the steps."""

import pytest
import torch

from expertaug import systems
from expertaug.models.decoder import Decoder
from expertaug.models.interactions.mlp import MLPInteraction
from expertaug.systems.solvers import adjoint
from expertaug.systems.solvers.adjoint import Part, Scheme, solve_with_adjoint, sum_of, takes_adjoint
from expertaug.systems.solvers.solver import Solver

METHODS = ("euler", "midpoint", "rk4", "lawson4", "ab4", "ab5")
GRIDS = {
    "even": torch.linspace(0.0, 3.0, 16, dtype=torch.float64),
    "uneven": torch.tensor([0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.7, 0.9, 1.1, 1.2, 1.25, 1.9], dtype=torch.float64),
}


class Field:
    """A driven, damped swing of two numbers for samples (S, B), and what it depends on."""

    def __init__(self):
        generator = torch.Generator().manual_seed(0)
        self.given = [torch.rand(2, 3, 1, generator=generator, dtype=torch.float64) + 1 for _ in range(2)]
        self.y0 = torch.randn(2, 3, 2, generator=generator, dtype=torch.float64)
        for tensor in (*self.given, self.y0):
            tensor.requires_grad_()

    def parts(self, times=1):
        stiffness, damping = (x.repeat_interleave(times, -2) for x in self.given)

        def swing(s, y):
            return torch.cat((y[..., 1:], -stiffness * torch.sin(y[..., :1]) + torch.sin(3 * self.when(s))), -1)

        def friction(s, y):
            return torch.cat((torch.zeros_like(damping), -damping * y[..., 1:] * y[..., 1:].abs()), -1)

        return [Part(swing, (0, 1)), Part(friction, (1,))]

    @staticmethod
    def when(s):
        return s if s.dim() == 0 else s.unsqueeze(-1)

    def gradients(self, states):
        return torch.autograd.grad(states.sin().sum(), (*self.given, self.y0))


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("method", METHODS)
def test_the_gradient_is_that_of_the_steps(method, grid):
    field, t, solver = Field(), GRIDS[grid], Solver(method, substeps=2)
    with_graph = solver(sum_of(field.parts()), field.y0, t)
    without = solve_with_adjoint(solver, field.parts(), field.parts, field.y0, t)
    assert torch.allclose(with_graph, without, rtol=1e-12, atol=1e-12)
    assert type(without.grad_fn).__name__ == "_AdjointBackward"
    for expected, found in zip(field.gradients(with_graph), field.gradients(without), strict=True):
        assert torch.allclose(expected, found, rtol=1e-10, atol=1e-10)


def test_a_scheme_once_it_has_started_has_as_many_weights_as_its_order():
    scheme = Scheme.of(Solver("ab5", substeps=2), torch.linspace(0.0, 5.0, 51, dtype=torch.float64))
    assert {len(weights) for _, weights in scheme.earlier[20:]} == {5}
    assert {len(weights) for _, weights in scheme.later[20:-5]} == {5}
    assert len(scheme.states) == 51


@pytest.mark.parametrize("t", [GRIDS["even"][:1], torch.linspace(0, 60, 600, dtype=torch.float64)])
def test_no_steps_and_very_many_are_solved_with_a_graph(t):
    field, solver = Field(), Solver("rk4")
    states = solve_with_adjoint(solver, field.parts(), field.parts, field.y0, t)
    assert torch.equal(states, solver(sum_of(field.parts()), field.y0, t))


def test_a_field_that_is_another_one_the_second_time_is_solved_with_a_graph():
    field, calls, t, solver = Field(), [], GRIDS["even"], Solver("rk4")

    def changing(times):
        calls.append(times)
        return [*field.parts(times), Part(lambda s, y: 0.01 * y, (0, 1))]

    states = solve_with_adjoint(solver, field.parts(), changing, field.y0, t)
    assert calls and torch.equal(states, solver(sum_of(field.parts()), field.y0, t))


def test_a_field_that_takes_one_time_only_is_solved_with_a_graph():
    field, t, solver = Field(), GRIDS["even"], Solver("rk4")

    def switched(s, y):
        return y if s > 1.5 else -y

    states = solve_with_adjoint(solver, [Part(switched, (0, 1))], lambda _: [Part(switched, (0, 1))], field.y0, t)
    assert torch.equal(states, solver(switched, field.y0, t))


def test_a_sample_that_runs_away_leaves_the_others_their_gradient():
    field, t, solver = Field(), GRIDS["even"], Solver("ab5")

    def parts(times=1):
        power = torch.tensor([1.0, 2.0, 1.0], dtype=torch.float64).view(3, 1).repeat_interleave(times, 0)
        stiffness = field.given[0].repeat_interleave(times, -2)
        return [Part(lambda s, y: stiffness * y.abs().pow(power * 8) / 8, (0, 1))]

    with torch.no_grad():
        field.y0.copy_(torch.full_like(field.y0, 0.8))
        field.y0[:, 1] = 9.0
    states = solve_with_adjoint(solver, parts(), parts, field.y0, t)
    assert not torch.isfinite(states[:, :, 1]).all()
    kept = states[:, :, ::2]
    (found,) = torch.autograd.grad(kept.sum(), field.given[0])
    (expected,) = torch.autograd.grad(solver(sum_of(parts()), field.y0, t)[:, :, ::2].sum(), field.given[0])
    assert torch.allclose(found[:, ::2], expected[:, ::2], rtol=1e-9)
    assert torch.isfinite(found[:, ::2]).all()


def test_where_precisions_differ_the_higher_one_stays():
    decoder, t = Decoder(systems.load({"name": "pendulum"})), GRIDS["even"]
    z_e = torch.full((3, 1), 2.0, dtype=torch.float64, requires_grad=True)
    states = decoder.forecast(torch.ones(3, 2), z_e, torch.zeros(3, 0), t, Solver("ab5"))
    assert states[1:].dtype == torch.float64 and type(states.grad_fn).__name__ != "_AdjointBackward"


@pytest.mark.parametrize(
    ("solver", "shape", "width", "taken"),
    [
        (Solver("ab5"), (3, 100, 2), 32, True),
        (Solver("ab5"), (3, 100, 2), 150, False),
        (Solver("dopri5"), (3, 100, 2), 32, False),
        (Solver("rodas3"), (3, 100, 2), 32, False),
        (Solver("rk4"), (3, 4, 64), 32, False),
    ],
)
def test_taken_where_it_costs_less(solver, shape, width, taken):
    assert takes_adjoint(solver, torch.zeros(shape), width) is taken


@pytest.mark.parametrize(
    "options",
    [{}, {"components": ["omega"], "reads": ["omega"]}, {"time": True, "harmonics": 2}, {"activation": "selu"}],
)
@pytest.mark.parametrize("rest", [0, 2])
def test_a_decoder_with_a_network_has_the_same_gradients(options, rest, monkeypatch):
    torch.manual_seed(0)
    system = systems.load({"name": "pendulum"})
    interaction = MLPInteraction(system, 1, **({"layers": [5, 4], "activation": "silu"} | options))
    decoder = Decoder(system, interaction).double()
    for parameter in decoder.parameters():
        parameter.data = parameter.data.unsqueeze(0).repeat(2, *[1] * parameter.dim())
    y0, z_e = torch.randn(2, 4 + rest, 2).double(), torch.rand(2, 4 + rest, 1).double().requires_grad_()
    z_a, t = torch.randn(2, 4, 1).double().requires_grad_(), GRIDS["even"]
    wanted = (z_e, z_a, *decoder.parameters())

    def gradients():
        states = decoder.forecast(y0, z_e, z_a, t, Solver("ab5", substeps=2))
        return type(states.grad_fn).__name__, torch.autograd.grad(states.sin().sum(), wanted)

    name, found = gradients()
    monkeypatch.setattr(adjoint, "EXPLICIT", ())
    other, expected = gradients()
    assert name == "_AdjointBackward" != other
    for a, b in zip(found, expected, strict=True):
        assert torch.allclose(a, b, rtol=1e-9, atol=1e-10)
