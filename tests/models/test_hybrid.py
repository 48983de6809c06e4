"""What every hybrid model must do, whatever it is made of."""

import numpy as np
import pytest
import torch

from cards import card
from expertaug import systems
from expertaug.errors import InputError
from expertaug.models import store
from expertaug.models.estimators import Hybrid
from expertaug.models.hybrid import HybridModel
from expertaug.systems.double_pendulum import DoublePendulum
from expertaug.systems.pendulum import DampedPendulum
from expertaug.systems.solvers.solver import Solver
from seen import seen

CONSTANTS = {"B1": 0.103, "G1": 69.4, "B2": 1.35, "G2": 93.5}
PENDULUM = {
    "system": {"name": "pendulum"},
    "model": {
        "encoder": {"kind": "recurrent", "hidden": 8, "layers": [6]},
        "interaction": {"kind": "mlp", "layers": [5, 5]},
    },
    "step": 0.1,
}
WINDOWS = {"theta1": [0.0, 0.1], "theta2": [0.05, 0.1]}
DOUBLE = {
    "system": {"name": "double_pendulum", "constants": CONSTANTS},
    "model": {
        "encoder": {
            "kind": "window",
            "windows": WINDOWS,
            "angles": ["theta1", "theta2"],
            "layers": [9, 7],
            "latent": 3,
        },
        "interaction": {"kind": "mlp", "layers": [5, 5]},
    },
    "step": 0.01,
}


def describe(case, seeds, **extra):
    t = (np.arange(20) * case["step"]).tolist()
    base = {"kind": "hybrid", "t": t, "observed": 11, "seeds": seeds, "expert": True, "interaction": True}
    return base | {"system": case["system"], "model": case["model"]} | extra


def make(case, seeds, **extra):
    description = describe(case, seeds, **extra)
    return Hybrid.network(systems.load(case["system"]), card(description)), description


def data_for(case, seeds, samples=6):
    size = len(systems.load(case["system"]).state)
    return torch.randn(20, 1, samples, size, generator=torch.Generator().manual_seed(1)).expand(-1, seeds, -1, -1)


@pytest.mark.parametrize("case", [PENDULUM, DOUBLE], ids=["pendulum", "double_pendulum"])
@pytest.mark.parametrize("parts", [{}, {"expert": False}, {"interaction": False}], ids=["hybrid", "ml", "expert"])
class TestEveryModel:
    def test_gradient_reaches_every_parameter(self, case, parts):
        model, description = make(case, [0, 1], **parts)
        y = data_for(case, 2)
        forecast, _ = model.predict(seen(y[:11], torch.tensor(description["t"])), Solver("rk4"))
        (forecast.square().sum() + model.estimate(seen(y[:11])).z_e.sum()).backward()
        unused = {"encoder.latent_head.layers.0.weight", "encoder.latent_head.layers.0.bias"}
        for name, parameter in model.named_parameters():
            if parts.get("interaction") is False and name in unused:
                continue  # nothing reads z_a without an interaction model
            assert parameter.grad is not None and parameter.grad.abs().sum() > 0, name

    def test_a_block_computes_what_each_seed_does_alone(self, case, parts):
        group, description = make(case, [3, 4, 5], **parts)
        y, t = data_for(case, 3), torch.tensor(description["t"])
        together, _ = group.predict(seen(y[:11], t), Solver("rk4"))
        for k, seed in enumerate([3, 4, 5]):
            alone, _ = make(case, [seed], **parts)[0].predict(seen(y[:11, :1], t), Solver("rk4"))
            torch.testing.assert_close(together[:, k], alone[:, 0], rtol=1e-4, atol=1e-5)

    def test_saves_and_loads_to_the_same_bits(self, case, parts, tmp_path):
        model, description = make(case, [0, 1], **parts)
        store.save(tmp_path / "m.safetensors", model, card(description))
        again = store.load(tmp_path / "m.safetensors")
        y, t = data_for(case, 2), torch.tensor(description["t"])
        assert again.seeds == [0, 1]
        assert torch.equal(
            model.predict(seen(y[:11], t), Solver("rk4"))[0], again.model.predict(seen(y[:11], t), Solver("rk4"))[0]
        )


def test_expert_alone_is_the_experts_trajectory():
    model, description = make(PENDULUM, [0], interaction=False)
    t, y = torch.tensor(description["t"]), data_for(PENDULUM, 1)
    with torch.no_grad():
        forecast, z_e = model.predict(seen(y[:11], t), Solver("rk4"))
    expected = Solver("rk4")(lambda s, x: model.system.expert(s, x, z_e), y[0], t)
    assert torch.equal(forecast, expected)
    assert torch.allclose(model.predict(seen(y[:11], t), Solver("rk4"))[0], expected, rtol=1e-5, atol=1e-6)
    assert (z_e > 0).all()


def test_forecast_from_the_last_observed_point_keeps_the_observation():
    model, description = make(PENDULUM, [0])
    t, y = torch.tensor(description["t"]), data_for(PENDULUM, 1)
    forecast, _ = model.predict(seen(y[:11], t), Solver("rk4"), start="y_t1")
    assert torch.equal(forecast[:11], y[:11])
    assert forecast.shape == y.shape


def test_window_encoder_sees_its_windows_only():
    model, _ = make(DOUBLE, [0])
    y = data_for(DOUBLE, 1).clone()
    before = model.encode(seen(y[:11])).z_e.mean
    y[1:5, ..., 1] += 1.0  # θ2 before 50 ms
    y[..., 2:] += 1.0  # speeds
    assert torch.equal(model.encode(seen(y[:11])).z_e.mean, before)
    y[5, ..., 1] += 1.0
    assert not torch.equal(model.encode(seen(y[:11])).z_e.mean, before)


def test_inputs_are_standardised_by_the_training_set():
    system = DoublePendulum(constants=CONSTANTS)
    encoder = HybridModel(system, **DOUBLE["model"]).build_one(torch.arange(11) * 0.01).encoder
    observed = torch.randn(11, 4000, 4) * 0.3
    encoder.fit(observed)
    x = encoder.scale(encoder.inputs(observed))
    torch.testing.assert_close(x.mean(0), torch.zeros(x.shape[1]), rtol=0, atol=1e-4)
    torch.testing.assert_close(x.std(0), torch.ones(x.shape[1]), rtol=1e-3, atol=0)


def test_bad_model_settings_are_named(tmp_path):
    system, times = DampedPendulum(), torch.arange(11) * 0.1
    good = PENDULUM["model"]
    with pytest.raises(InputError, match=r"model\.encoder\.kind.*'cnn'"):
        HybridModel(system, **(good | {"encoder": {"kind": "cnn"}})).build_one(times)
    with pytest.raises(InputError, match=r"model\.interaction\.width.*unknown"):
        HybridModel(system, **(good | {"interaction": {"kind": "mlp", "width": 3}})).build_one(times)
    double = DoublePendulum(constants=CONSTANTS)
    with pytest.raises(InputError, match=r"windows\.theta3"):
        HybridModel(double, **(good | {"encoder": {"kind": "window", "windows": {"theta3": [0, 1]}}})).build_one(times)
    (tmp_path / "m").write_bytes(b"nonsense")
    with pytest.raises(InputError, match="not a file of this package"):
        store.load(tmp_path / "m")


def test_a_file_whose_layers_have_changed_is_refused(tmp_path):
    model, description = make(PENDULUM, [0])
    model.encoder.more = torch.nn.Linear(1, 1)
    store.save(tmp_path / "m.safetensors", model, card(description))
    with pytest.raises(InputError, match="holds other layers than it describes; train it again"):
        store.load(tmp_path / "m.safetensors")


def test_an_encoder_from_elsewhere_needs_no_change_here():
    model = PENDULUM["model"] | {
        "encoder": {"kind": "expertaug.models.encoders.recurrent:RecurrentEncoder", "hidden": 4, "layers": [3]}
    }
    assert HybridModel(DampedPendulum(), **model).build_one(torch.arange(3) * 0.1).encoder.latent == 4
