"""Known inputs between the times of the data, in sets and in what an encoder sees."""

import numpy as np
import pytest
import torch
from driven_sets import DAMPING, FREQUENCY, T, simulated

import expertaug as ea
from expertaug.errors import InputError
from expertaug.systems.inputs import Linear, as_observed, inputs_of, solve, states_of
from expertaug.windows import Windows


class Integrator(ea.System):
    """y' = k u, z_e = k."""

    state = (ea.Parameter("y"),)
    expert_parameters = (ea.Parameter("k"),)
    inputs = (ea.Parameter("u", scale=2.0),)

    def __init__(self, interpolation="linear"):
        self.interpolation = interpolation

    def expert(self, t, y, z_e, u):
        return z_e * u


class Blurred(Integrator):
    """A field of four cells that are driven alike, and a covariate."""

    covariates = (ea.Parameter("c"),)

    @property
    def state_shape(self):
        return (1, 4)


TIMES = torch.tensor([0.0, 0.5, 2.0, 3.0], dtype=torch.float64)
U = torch.tensor([[1.0, 0.0], [3.0, 1.0], [-1.0, 5.0], [2.0, 7.0]], dtype=torch.float64).unsqueeze(-1)  # (T, B, U)


def test_inputs_are_straight_between_their_times_at_one_time_or_one_for_each_sample():
    signal = Linear(TIMES, U)
    assert signal(torch.tensor(1.25, dtype=torch.float64)).flatten().tolist() == [1.0, 3.0]
    for s, u in zip(TIMES, U, strict=True):
        assert torch.equal(signal(s), u)
    each = signal(torch.tensor([0.25, 2.5], dtype=torch.float64))
    assert each.flatten().tolist() == [2.0, 6.0]


@pytest.mark.parametrize("solver", [ea.Solver("rk4"), ea.Solver("dopri5"), ea.Solver("rodas3"), ea.Solver("radau")])
@pytest.mark.parametrize("how", ["linear", "constant"])
def test_an_integrator_has_the_area_under_its_input(solver, how):
    """Trapezoids under straight lines, rectangles under what holds until the next time."""
    system, y0 = Integrator(how), torch.zeros(2, 1, dtype=torch.float64)
    k = torch.tensor([[1.0], [2.0]], dtype=torch.float64)
    y = solve(system, lambda s, y, u: system.expert(s, y, k, u), y0, TIMES, solver, k, U)
    height = U[:-1] if how == "constant" else (U[:-1] + U[1:]) / 2
    area = torch.cumsum(height * TIMES.diff()[:, None, None], 0)
    assert torch.allclose(y[1:], k * area, atol=1e-5)


def test_what_is_observed_is_states_and_inputs():
    y, u = torch.rand(3, 2, 5, 1, 4), torch.rand(3, 2, 5, 2)
    windows, system = Windows(torch.arange(3.0), y, u).joined, Blurred()
    assert windows.shape == (3, 2, 5, 3, 4)
    assert torch.equal(states_of(system, windows), y)
    assert torch.equal(inputs_of(system, windows), u)
    seen = as_observed(system)
    assert [p.name for p in seen.state] == ["y", "u", "c"] and seen.state_shape == (3, 4)
    assert Windows(torch.arange(3.0), y).joined is y and states_of(ea.DampedPendulum(), y) is y


def test_networks_see_inputs_in_units_of_their_scale():
    seen = as_observed(Integrator())
    assert seen.features(torch.tensor([[3.0, 4.0]])).tolist() == [[3.0, 2.0]]


def test_the_torque_is_what_was_drawn():
    data = simulated("train", 5, noise=0.0)
    assert data.u.shape == (5, 21, 1) and data.u.dtype == np.float32
    assert len(np.unique(data.u[:, 0])) == 5 and (np.abs(data.u) <= 40).all()
    same = ea.simulate(ea.DrivenPendulum(), FREQUENCY, DAMPING, u=data.u, n=5, t=T)
    assert np.array_equal(same.u, data.u) and np.array_equal(same.z_e, data.z_e)
    assert np.array_equal(simulated("train", 5, noise=0.0).y, data.y)


def test_without_a_torque_it_is_the_damped_pendulum():
    data = ea.simulate(ea.DrivenPendulum(), FREQUENCY, DAMPING, u=np.zeros((4, 21, 1)), n=4, t=T)
    free = ea.simulate(ea.DampedPendulum(), FREQUENCY, {"alpha": DAMPING["gamma"]}, n=4, t=T)
    assert np.abs(data.y - free.y).max() < 1e-6


@pytest.mark.slow
def test_a_measured_source_that_follows_the_formula_is_the_circuit_of_the_formula():
    t = np.arange(401) * 0.01  # fine enough that straight lines are the sine
    z_e, z_a = {"L": (1, 3), "C": (0.5, 1.5)}, {"R": (1, 3)}
    source = (2.5 * np.sin(2 * t) + 1)[None, :, None].repeat(3, axis=0)
    measured = ea.simulate(ea.RLC(source="measured"), z_e, z_a, u=source, n=3, t=t)
    formula = ea.simulate(ea.RLC(), z_e, z_a, n=3, t=t)
    assert np.abs(measured.y - formula.y).max() < 1e-4
    drawn = ea.simulate(
        ea.RLC(source="measured"), z_e, z_a, inputs={"V0": (1, 1), "V1": (2.5, 2.5), "w": (2, 2)}, n=3, t=t
    )
    assert np.abs(drawn.u - source).max() < 1e-6


def test_a_set_with_inputs_is_saved_cut_and_chosen_from(tmp_path):
    data = simulated("train", 6)
    data.save(tmp_path / "set.npz")
    again = ea.Trajectories.load(tmp_path / "set.npz")
    assert np.array_equal(again.u, data.u)
    assert np.array_equal(data.subset(np.array([4, 1])).u, data.u[[4, 1]])
    assert np.array_equal(data.window(2, 7).u, data.u[:, 2:7])


def test_covariates_are_constant_and_the_last_inputs():
    class Weighted(ea.DrivenPendulum):
        covariates = (ea.Parameter("mass", "kg"),)

        def expert(self, t, y, z_e, u):
            return super().expert(t, y, z_e, u[..., :1] / u[..., 1:])

    options = {"n": 3, "t": T, "inputs": {"A": (5, 5), "f": (1, 1), "mass": (1, 2)}}
    data = ea.simulate(Weighted(), FREQUENCY, DAMPING, **options)
    assert (data.u[:, :, 1] == data.u[:, :1, 1]).all() and len(np.unique(data.u[:, 0, 1])) == 3


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: simulated("train", 2, inputs={"A": (0, 1)}), "inputs: given for ['A']"),
        (lambda: simulated("train", 2, inputs=None, u=np.zeros((2, 5, 1))), "u: has shape (2, 5, 1)"),
        (lambda: simulated("train", 2, inputs=None, u=np.zeros((2, 21, 2))), "u: u has 2 components"),
        (
            lambda: ea.simulate(ea.DampedPendulum(), FREQUENCY, {"alpha": (0, 1)}, n=2, t=T, inputs={"A": (0, 1)}),
            "DampedPendulum has no known inputs",
        ),
        (lambda: ea.simulate(Driven(), FREQUENCY, {}, n=2, t=T), "Driven draws no inputs: give them, u (n, T, 1)"),
        (lambda: ea.Trajectories(T, np.zeros((2, 21, 2)), np.zeros((2, 1)), u=np.zeros((2, 20, 1))), "u has shape"),
        (
            lambda: ea.Trajectories(T, np.zeros((2, 21, 2)), np.zeros((2, 1)), u=np.full((2, 21, 1), np.nan)),
            "u is not finite, first at index (0, 0, 0)",
        ),
    ],
)
def test_what_is_wrong_with_inputs_is_one_line(call, expected):
    with pytest.raises(InputError) as found:
        call()
    assert expected in str(found.value) and "\n" not in str(found.value)


class Driven(ea.DrivenPendulum):
    """One that draws no torque itself."""

    input_parameters = ()
    interaction_parameters = ()
    input_signal = ea.System.input_signal
