"""The RLC circuit against its linear solution."""

import pytest
import torch

from expertaug import systems
from expertaug.errors import InputError
from expertaug.systems.rlc import AMPLITUDE, OFFSET, RLC
from expertaug.systems.settings import SimulatedData, SimulatedSet
from expertaug.systems.simulate import sample

TRAIN = SimulatedSet(size=20, z_e={"L": (1.0, 5.0), "C": (0.5, 2.5)}, z_a={"R": (1.0, 3.0)})
DATA = SimulatedData(seed=0, step_s=0.1, t2_s=20.0, noise=0.0, sets={"train": TRAIN})


def exact(t, y0, z_e, z_a, by, source_rad_s):
    """Matrix exponential of the circuit with its source as two more states, sin(ω t) and cos(ω t), and a constant."""
    (inductance, capacitance), resistance, w = z_e, z_a[0], source_rad_s
    drop = {"kirchhoff": inductance, "additive": capacitance, "code": inductance * capacitance}[by]
    m = torch.zeros(5, 5, dtype=torch.float64)
    m[0, 1] = 1 / capacitance
    m[1, :3] = torch.tensor([-1 / inductance, -resistance / drop, AMPLITUDE / inductance])
    m[1, 4] = OFFSET / inductance
    m[2, 3], m[3, 2] = w, -w
    start = torch.cat((y0, torch.tensor([0.0, 1.0, 1.0], dtype=torch.float64)))
    return torch.stack([torch.linalg.matrix_exp(m * s) @ start for s in t])[:, :2]


@pytest.mark.parametrize("equations", ["kirchhoff", "additive", "code"])
@pytest.mark.parametrize("source_rad_s", [2.0, 0.0])
def test_simulation_is_the_linear_solution(equations, source_rad_s):
    system = RLC(equations=equations, source_rad_s=source_rad_s)
    data = sample(system, DATA, "train")
    t, z_e, z_a = (torch.from_numpy(x).double() for x in (data.t[:50], data.z_e, data.z_a))
    for k in range(3):
        y0 = torch.from_numpy(data.y[k, 0]).double()
        expected = exact(t, y0, z_e[k], z_a[k], equations, source_rad_s)
        torch.testing.assert_close(torch.from_numpy(data.y[k, :50]).double(), expected, rtol=1e-4, atol=1e-5)


def test_kirchhoffs_voltage_law_holds():
    """V = U + R I + L dI/dt and I = C dU/dt, whatever the state."""
    system = RLC()
    y, z_e, z_a = torch.randn(7, 2), torch.rand(7, 2) + 0.5, torch.rand(7, 1) + 1
    t = torch.tensor(0.7)
    rate = system.truth(t, y, z_e, z_a)
    voltage = y[:, 0] + z_a[:, 0] * y[:, 1] + z_e[:, 0] * rate[:, 1]
    torch.testing.assert_close(voltage, (2.5 * torch.sin(2 * t) + 1).expand(7))
    torch.testing.assert_close(y[:, 1], z_e[:, 1] * rate[:, 0])


def test_the_expert_lacks_the_resistance_alone():
    system = RLC()
    y, z_e, t = torch.randn(7, 2), torch.rand(7, 2) + 0.5, torch.tensor(0.3)
    assert torch.equal(system.expert(t, y, z_e), system.truth(t, y, z_e, torch.zeros(7, 1)))


def test_starts_without_current():
    y0 = RLC().sample_initial_state(4000, torch.Generator().manual_seed(0))
    assert (y0[:, 1] == 0).all()
    assert abs(y0[:, 0].std() - 1) < 0.05


def test_unknown_equations_are_named():
    with pytest.raises(InputError, match=r"system\.equations: 'ohm'; one of kirchhoff, additive, code"):
        systems.load({"name": "rlc", "equations": "ohm"})
