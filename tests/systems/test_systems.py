"""Systems and simulation against closed forms."""

import json
import math
import subprocess
import sys
import zlib

import numpy as np
import pytest
import torch

from expertaug import systems
from expertaug.cli import main
from expertaug.errors import InputError, SolveError
from expertaug.systems.base import constant_like
from expertaug.systems.double_pendulum import Constants, accelerations, energy, point_masses
from expertaug.systems.driven_pendulum import DrivenPendulum
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.settings import SYSTEMS, PendulumSettings, SimulatedData, SimulatedSet, SimulateJob
from expertaug.systems.simulate import sample, simulate, trajectories
from expertaug.systems.solvers.solver import Solver, check_finite
from expertaug.trajectories import Trajectories

REAL = Constants(0.103, 69.4, 1.35, 93.5)


def pendulum_data(size=50, noise=0.0, alpha=(0.0, 0.6)):
    train = SimulatedSet(size=size, z_e={"omega0": (1.5, 3.1)}, z_a={"alpha": alpha})
    return SimulatedData(seed=0, step_s=0.1, t2_s=20.0, noise=noise, sets={"train": train})


@pytest.mark.parametrize("name", SYSTEMS)
def test_units_of_parameters_are_the_systems_own(name):
    given = {"constants": {"B1": 0.1, "G1": 69.0, "B2": 1.3, "G2": 93.0}} if name == "double_pendulum" else {}
    system = systems.load({"name": name} | given)
    parameters = (*system.expert_parameters, *system.interaction_parameters, *system.input_parameters)
    assert {p.name: p.unit for p in parameters if p.unit} == SYSTEMS[name].UNITS


def test_undamped_pendulum_keeps_its_energy():
    data = sample(DampedPendulum(), pendulum_data(alpha=(0.0, 0.0)), "train")
    theta, speed = data.y[..., 0].astype(float), data.y[..., 1].astype(float)
    total = speed**2 / 2 + data.z_e.astype(float) ** 2 * (1 - np.cos(theta))
    assert np.abs(total / total[:, :1] - 1).max() < 1e-4


def test_a_pendulum_may_start_anywhere_at_a_distance_from_rest():
    system = DampedPendulum(start_radius=[1.3, 2.3])
    y0 = system.sample_initial_state(500, torch.Generator().manual_seed(0))
    distance = y0.norm(dim=1)
    assert distance.min() >= 1.3 and distance.max() <= 2.3 and np.ptp(distance.numpy()) > 0.9
    assert (y0[:, 1].abs() > 0.5).float().mean() > 0.5
    for bad in ([1.0], [2.0, 1.0], [0.0, 9.0]):
        with pytest.raises(InputError, match="start_radius"):
            systems.load({"name": "pendulum", "start_radius": bad})


def test_a_hidden_torque_moves_the_driven_pendulum_as_a_known_one_does():
    known, hidden = (DrivenPendulum(torque=torque) for torque in ("known", "hidden"))
    assert [p.name for p in hidden.interaction_parameters] == ["gamma", "A", "f"] and not hidden.inputs
    t = torch.tensor(0.3, dtype=torch.float64)
    y = torch.tensor([[0.4, -0.2], [1.0, 0.5]], dtype=torch.float64)
    z_e, z_a = y.new_tensor([[2.0], [1.5]]), y.new_tensor([[0.3, 5.0, 0.7], [0.1, 20.0, 1.1]])
    torque = z_a[:, 1:2] * torch.cos(2 * math.pi * z_a[:, 2:] * t)
    told = known.truth(t, y, z_e, z_a[:, :1], torque)
    torch.testing.assert_close(hidden.truth(t, y, z_e, z_a), told)
    torch.testing.assert_close(hidden.expert(t, y, z_e), known.expert(t, y, z_e, torch.zeros(2, 1, dtype=y.dtype)))


@pytest.mark.parametrize("name", ["pendulum", "driven_pendulum"])
def test_a_pendulum_of_which_the_angle_is_seen_has_its_errors_alone(name):
    y = torch.rand(4, 2, generator=torch.Generator().manual_seed(0))
    assert torch.equal(systems.load({"name": name, "observed": "angle"}).observe(y), y[:, :1])
    assert torch.equal(systems.load({"name": name}).observe(y), y)
    with pytest.raises(InputError, match=r"system\.observed"):
        systems.load({"name": name, "observed": "speed"})


def test_a_pendulum_whose_friction_is_the_experts_moves_as_the_other():
    train = SimulatedSet(size=6, z_e={"omega0": (1.5, 3.1), "alpha": (0.0, 0.6)})
    rubbed = pendulum_data().model_copy(update={"sets": {"train": train}})
    system = DampedPendulum(friction="estimated")
    assert [p.name for p in system.expert_parameters] == ["omega0", "alpha"] and not system.interaction_parameters
    assert PendulumSettings(friction="estimated").expert_names == ("omega0", "alpha")
    one = sample(system, rubbed, "train")
    y, z_e, z_a = torch.from_numpy(one.y[:, 3]), torch.from_numpy(one.z_e[:, :1]), torch.from_numpy(one.z_e[:, 1:])
    t = torch.zeros(())
    other = DampedPendulum().truth(t, y, z_e, z_a)
    torch.testing.assert_close(system.expert(t, y, torch.from_numpy(one.z_e)), other)
    with pytest.raises(InputError, match=r"system\.friction"):
        systems.load({"name": "pendulum", "friction": "known"})


def test_small_damped_oscillation_is_the_linear_solution():
    class Small(DampedPendulum):
        def sample_initial_state(self, n, generator):
            return torch.tensor([[1e-3, 0.0]], dtype=torch.float64).expand(n, 2)

    data = sample(Small(), pendulum_data(size=8), "train")
    omega0, alpha = data.z_e[:, :1].astype(float), data.z_a.astype(float)
    frequency = np.sqrt(omega0**2 - alpha**2 / 4)
    phase = frequency * data.t
    expected = 1e-3 * np.exp(-alpha * data.t / 2) * (np.cos(phase) + alpha / (2 * frequency) * np.sin(phase))
    assert (
        np.abs(data.y[..., 0] - expected).max() < 1e-6
    )  # a thousandth of the amplitude, which is what sin θ ≈ θ leaves


def test_every_seed_and_every_name_has_numbers_of_its_own():
    """Those of seed 0 are the name's alone, as ever."""
    ranges, t = {"omega0": (0.0, 1.0)}, np.arange(2) * 0.1
    system = DampedPendulum()
    drawn = {
        (seed, name): trajectories(system, ranges, {"alpha": (0.0, 0.0)}, n=20, t=t, seed=seed, name=name).z_e[:, 0]
        for seed in (0, 1, 2, 7, 2**31 - 1)
        for name in ("train", "validation")
    }
    values = np.stack(list(drawn.values()))
    assert len(np.unique(values)) == values.size
    assert np.abs(np.corrcoef(values) - np.eye(len(values))).max() < 0.75
    old = torch.Generator().manual_seed(zlib.crc32(b"train"))
    np.testing.assert_array_equal(
        drawn[0, "train"], torch.rand(20, 1, dtype=torch.float64, generator=old)[:, 0].float().numpy()
    )


def test_simulation_is_reproducible_and_sets_are_independent(tmp_path):
    data = pendulum_data(noise=0.01)
    data = data.model_copy(update={"sets": dict.fromkeys(("train", "test"), data.sets["train"])})
    job = SimulateJob(system=PendulumSettings(), data=data)
    for name, folder in (("train", "a"), ("train", "b"), ("test", "a")):
        simulate(name, tmp_path / folder / f"{name}.npz", job)
    assert (tmp_path / "a/train.npz").read_bytes() == (tmp_path / "b/train.npz").read_bytes()
    first, other = (Trajectories.load(tmp_path / f"a/{n}.npz") for n in ("train", "test"))
    assert not np.array_equal(first.z_e, other.z_e)


def test_noise_is_on_every_point_including_the_first():
    clean, noisy = (sample(DampedPendulum(), pendulum_data(200, s), "train") for s in (0.0, 0.01))
    assert np.std((noisy.y - clean.y)[:, 0]) == pytest.approx(0.01, rel=0.15)
    assert np.std((noisy.y - clean.y)[:, -1]) == pytest.approx(0.01, rel=0.15)


@pytest.mark.slow
def test_double_pendulum_energy_is_conserved_without_friction_and_lost_with_it():
    y0 = torch.tensor([[2.0, 1.5, 3.0, -5.0], [0.5, -2.0, 12.0, 20.0]], dtype=torch.float64)
    t = torch.linspace(0, 2, 5, dtype=torch.float64)
    solver = Solver("dopri8", 1e-10, 1e-10)
    for friction, kept in (((0.0, 0.0), True), ((0.02, 0.12), False)):
        y = solver(lambda s, y, f=friction: torch.cat((y[..., 2:], accelerations(y, REAL, f)), -1), y0, t)
        change = energy(y.numpy(), REAL)[-1] / energy(y.numpy(), REAL)[0] - 1
        assert (np.abs(change) < 1e-6).all() if kept else (change < -1e-3).all()


def test_point_masses_are_the_papers_equations():
    l1, l2, m, g = 0.091, 0.070, 1.0, 9.81
    t1, t2, w1, w2 = np.random.default_rng(0).uniform(-3, 3, (4, 20)) * np.array([[1], [1], [9], [15]])
    common = 2 * m + m - m * np.cos(2 * t1 - 2 * t2)
    a1 = -g * 3 * m * np.sin(t1) - m * g * np.sin(t1 - 2 * t2)
    a1 -= 2 * np.sin(t1 - t2) * m * (w2**2 * l2 + w1**2 * l1 * np.cos(t1 - t2))
    a2 = w1**2 * l1 * 2 * m + g * 2 * m * np.cos(t1) + w2**2 * l2 * m * np.cos(t1 - t2)
    expected = np.stack((a1 / (l1 * common), 2 * np.sin(t1 - t2) * a2 / (l2 * common)), -1)
    found = accelerations(torch.from_numpy(np.stack((t1, t2, w1, w2), -1)), point_masses(l1, l2))
    np.testing.assert_allclose(found.numpy(), expected, rtol=1e-9)


def test_fixed_grid_agrees_with_tolerance():
    """One RK4 step a data interval: 3e-4 rad on the pendulum over the observed window."""
    system = DampedPendulum()
    z_e, y0 = torch.linspace(0.5, 3.5, 31).unsqueeze(-1), torch.tensor([[1.5, 0.0]]).expand(31, 2)
    t = torch.linspace(0, 5, 51)
    fixed, exact = (
        s(lambda q, y: system.expert(q, y, z_e), y0, t) for s in (Solver("rk4"), Solver("dopri5", 1e-7, 1e-7))
    )
    assert 1e-7 < (fixed - exact).abs().max() < 3e-3


def test_substeps_divide_the_datas_grid():
    t, y0 = torch.tensor([0.0, 0.1, 0.3], dtype=torch.float64), torch.ones(1, dtype=torch.float64)
    fine = torch.tensor([0.0, 0.05, 0.1, 0.2, 0.3], dtype=torch.float64)

    def decay(s, y):
        return -14.0 * y * (1 + s)

    found = Solver("rk4", substeps=2)(decay, y0, t)
    torch.testing.assert_close(found, Solver("rk4")(decay, y0, fine)[[0, 2, 4]])
    exact = torch.exp(-14.0 * (t + t**2 / 2))
    assert (found[:, 0] - exact).abs().max() < 0.2 * (Solver("rk4")(decay, y0, t)[:, 0] - exact).abs().max()


def test_bad_input_is_named():
    with pytest.raises(InputError, match=r"system.name.*'nothing'"):
        systems.load({"name": "nothing"})
    with pytest.raises(InputError, match=r"system.colour.*unknown"):
        systems.load({"name": "double_pendulum", "colour": 1})
    with pytest.raises(InputError, match=r"constants.*calibrate"):
        systems.load({"name": "double_pendulum"})
    with pytest.raises(InputError, match="min must not exceed max"):
        SimulatedSet.from_mapping({"size": 50, "z_e": {"omega0": [3.0, 1.0]}})
    with pytest.raises(InputError, match="euler9"):
        Solver("euler9")


@pytest.mark.parametrize("name", ["pendulm", "adams", "base", "settings", "solvers", "simulate", ""])
def test_what_is_no_system_is_told_of_systems_alone(name):
    with pytest.raises(InputError) as refused:
        systems.load({"name": name})
    known = str(refused.value).rpartition("known: ")[2]
    assert known == f"{', '.join(SYSTEMS)}; or a dotted path, or module:Class"
    assert ("did you mean 'pendulum'?" in str(refused.value)) == (name == "pendulm")


@pytest.mark.parametrize(
    ("where", "change", "expected"),
    [
        ("data", {"nois": 0.5}, "--settings.data.nois: unknown key; did you mean 'noise'?"),
        ("data", {"noise": "0.5"}, "--settings.data.noise: found '0.5'"),
        ("data", {"noise": -1.0}, "--settings.data.noise: found -1.0; give 0 or more"),
        ("data", {"sets": {"test": {"size": 1, "z_e": {}, "za": {}}}}, "data.sets.test.za: unknown key"),
        ("data", {"sets": {"test": {"z_e": {}}}}, "--settings.data.sets.test.size: missing"),
        ("data", {"sets": {}}, "data.sets: no set 'train'"),
        ("system", {"name": "pendulm"}, "--settings.system.name: 'pendulm' is no system; did you mean 'pendulum'?"),
        ("system", {"mass": 1.0}, "--settings.system.mass: unknown key; known: name"),
        ("sytem", {}, "--settings.sytem: unknown key; did you mean 'system'?"),
    ],
)
def test_a_misspelt_setting_is_one_line_and_nothing_is_simulated(tmp_path, capsys, where, change, expected):
    job = {"system": {"name": "pendulum"}, "data": json.loads(pendulum_data(size=2).model_dump_json())}
    job[where] = job.get(where, {}) | change
    assert main(["simulate", "train", "--output", str(tmp_path / "x.npz"), "--settings", json.dumps(job)]) == 2
    told = capsys.readouterr().err
    assert expected in told and len(told.splitlines()) == 1 and not list(tmp_path.iterdir())


def test_non_finite_trajectory_names_system_and_parameters():
    y = torch.zeros(3, 2, 5, 2)
    y[1, 1, 4, 0] = float("nan")
    z_e = torch.arange(10.0).reshape(2, 5, 1)
    with pytest.raises(SolveError, match=r"pendulum.*index \(1, 4\).*\(9\)"):
        check_finite(y, z_e, "pendulum")


def test_a_simulation_that_fails_names_set_and_parameters():
    class Runaway(DampedPendulum):
        def truth(self, t, y, z_e, z_a):
            return torch.where(z_e > 2.5, y.square().sum(-1, keepdim=True) * 1e3 + 1e3, y)

    with pytest.raises(SolveError, match=r"Runaway, set train.*index \(\d+,\) with parameters \((2\.[5-9]|3)"):
        sample(Runaway(), pendulum_data(), "train")


def test_trajectories_check_and_round_trip(tmp_path):
    data = Trajectories(np.arange(4.0), np.ones((3, 4, 2)), np.ones((3, 1)))
    data.save(tmp_path / "x.npz")
    assert np.array_equal(Trajectories.load(tmp_path / "x.npz").window(1, 3).y, data.y[:, 1:3])
    with pytest.raises(InputError, match="not finite"):
        Trajectories(np.arange(4.0), np.full((3, 4, 2), np.nan), np.ones((3, 1)))
    with pytest.raises(InputError, match="strictly increasing"):
        Trajectories(np.zeros(4), np.ones((3, 4, 2)), np.ones((3, 1)))
    with pytest.raises(InputError, match="z_e"):
        Trajectories(np.arange(4.0), np.ones((3, 4, 2)), np.ones((2, 1)))
    (tmp_path / "y.npz").write_bytes(b"nonsense")
    with pytest.raises(InputError, match=r"y\.npz.*not a trajectory file"):
        Trajectories.load(tmp_path / "y.npz")


@pytest.mark.slow
def test_torchdiffeq_comes_without_scipys_integrators_and_still_finds_them():
    code = """if True:
        import sys, torch
        from expertaug.systems.solvers.solver import odeint
        assert "scipy.integrate" not in sys.modules
        found = odeint(lambda t, y: -y, torch.ones(1), torch.tensor([0.0, 1.0]), method="scipy_solver")
        assert "scipy.integrate" in sys.modules
        print(float(found[-1]))
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(math.exp(-1), rel=1e-4)


def test_a_constant_made_within_a_transform_is_good_outside():
    x = torch.ones(2)

    def scaled(x: torch.Tensor) -> torch.Tensor:
        return (constant_like(x, [1.5, 2.5], x.dtype) * x).sum()

    torch.func.jvp(scaled, (x,), (x,))
    with torch.inference_mode():
        scaled(x)
    y = torch.ones(2, requires_grad=True)
    scaled(y).backward()
    assert y.grad.tolist() == [1.5, 2.5]
    assert not torch._C._functorch.is_functorch_wrapped_tensor(constant_like(x, [1.5, 2.5], x.dtype))
