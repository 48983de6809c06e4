"""From a learned term to an equation: known truths are found, and what is found can be used, written and read."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.api.explain import explain
from expertaug.errors import InputError
from expertaug.systems import Parameter, System
from nightly import others_slow
from rubbed_swings import NOISE, SEEN, T, fitted, swings

REAL = Path(__file__).parents[3] / "shared" / "measurements" / "real_pend_h_1.txt"


@cache
def explained(seed):
    """Sets of swings with friction, the expert alone fitted to them, and the equation that is found."""
    train, validation = swings("train", seed=seed), swings("validation", seed=seed)
    expert = fitted(train)
    return train, validation, expert, explain(expert, train, validation, by_hand=["omega: abs(omega)*omega"])


@pytest.fixture(scope="module")
def sets():
    return explained(0)[:2]


@pytest.fixture(scope="module")
def expert():
    return explained(0)[2]


@pytest.fixture(scope="module")
def found():
    return explained(0)[3]


@pytest.mark.parametrize("seed", others_slow(range(10)))
def test_friction_is_found_and_nothing_else(seed):
    train, _, _, found = explained(seed)
    (one,) = found.coefficients
    assert str(one.term) == "omega: omega"
    assert not one.shared  # each window has its own
    assert one.value == pytest.approx(-train.z_a.mean(), abs=2 * one.error) and one.error < 0.05
    assert one.spread == pytest.approx(train.z_a.std(), abs=0.05)
    assert one.verdict == "law"


@pytest.mark.slow
@pytest.mark.filterwarnings("error:Mean of empty slice")
def test_the_drag_is_found_where_nobody_measured_the_speed():
    ranges = {"k": (4.0, 4.0)}, {"c": (0.12, 0.12)}
    train, validation = (
        _without_speed(ea.simulate(Spring(), *ranges, n=8, t=T, noise=NOISE, seed=3, name=name))
        for name in ("train", "validation")
    )
    ranges = {"prior": {"k": (2.0, 8.0)}, "start": {"v": (-8.0, 8.0)}}
    model = fitted(train, Spring(), units={"k": "shared"}, **ranges)
    found = explain(model, train, validation, by_hand=["v: v"])
    (one,) = found.coefficients
    assert str(one.term) == "v: abs(v)*v"
    assert one.value == pytest.approx(-0.12, abs=4 * one.error) and one.error < 0.01


class Glider(System):
    """A glider on an air track that is not quite level; its true motion has a quadratic drag, too."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("a", "m/s²", positive=False, scale=0.1),)
    interaction_parameters = (Parameter("c", "1/m"),)

    def expert(self, t, y, z_e):
        return torch.stack((y[..., 1], z_e[..., 0] + 0 * y[..., 1]), dim=-1)

    def truth(self, t, y, z_e, z_a):
        drag = z_a[..., 0] * y[..., 1].abs() * y[..., 1]
        return self.expert(t, y, z_e) - torch.stack((torch.zeros_like(drag), drag), dim=-1)

    def sample_initial_state(self, n, generator):
        v = -0.6 + 1.6 * torch.rand(n, generator=generator, dtype=torch.float64)
        return torch.stack((torch.zeros_like(v), v), dim=-1)


@pytest.mark.slow
def test_precise_data_tell_a_drag_that_each_windows_own_constants_nearly_make_up_for():
    """A parabola of a glider's own follows three seconds of drag to a millimetre or two, which its sensor sees."""
    t, ranges = np.arange(31) * 0.1, ({"a": (0.08, 0.08)}, {"c": (0.15, 0.15)})
    train, validation = (
        _without_speed(ea.simulate(Glider(), *ranges, n=12, t=t, noise=5e-4, name=name))
        for name in ("train", "validation")
    )
    how = {"prior": {"a": (-0.5, 0.5)}, "start": {"v": (-2.0, 2.0)}, "noise": 5e-4}
    found = explain(ea.least_squares(Glider(), train, observed_s=1.5, **how), train, validation)
    (one,) = found.coefficients
    assert str(one.term) == "v: abs(v)*v"
    assert one.value == pytest.approx(-0.15, abs=4 * one.error) and one.error < 0.02


def _without_speed(data):
    return replace(data, mask=np.broadcast_to([True, False], data.y.shape))


def test_no_term_is_a_candidate():
    train, validation = swings("train", alpha=(0.0, 0.0)), swings("validation", alpha=(0.0, 0.0))
    found = explain(fitted(train), train, validation)
    assert found.terms == ()
    assert found.latex == "" and found.text == "no term"
    assert found.table.loc["equation", "log-MSE"] == found.table.loc["expert alone", "log-MSE"]


class Spring(System):
    """x'' = −k x; its true motion has a quadratic drag, too."""

    state = (Parameter("x", "m"), Parameter("v", "m/s"))
    expert_parameters = (Parameter("k", "1/s**2", scale=4.0),)
    interaction_parameters = (Parameter("c", "1/m"),)

    def expert(self, t, y, z_e):
        return torch.stack((y[..., 1], -z_e[..., 0] * y[..., 0]), dim=-1)

    def truth(self, t, y, z_e, z_a):
        drag = z_a[..., 0] * y[..., 1].abs() * y[..., 1]
        return self.expert(t, y, z_e) - torch.stack((torch.zeros_like(drag), drag), dim=-1)

    def sample_initial_state(self, n, generator):
        x = 1 + 2 * torch.rand(n, generator=generator, dtype=torch.float64)
        return torch.stack((x, torch.zeros_like(x)), dim=-1)


@pytest.mark.slow
def test_the_drag_of_ones_own_system_is_found_with_its_error():
    ranges = {"k": (4.0, 4.0)}, {"c": (0.12, 0.12)}
    train, validation = (
        ea.simulate(Spring(), *ranges, n=16, t=T, noise=NOISE, seed=3, name=name) for name in ("train", "validation")
    )
    model = fitted(train, Spring(), prior={"k": (2.0, 8.0)}, units={"k": "shared"})
    found = explain(model, train, validation, by_hand=["v: v"])
    (one,) = found.coefficients
    assert str(one.term) == "v: abs(v)*v" and one.shared
    assert one.value == pytest.approx(-0.12, abs=4 * one.error) and one.error < 0.004
    assert found.constants["k"][0] == pytest.approx(4.0, abs=4 * found.constants["k"][1])
    assert found.table.loc["equation", "log-MSE"] < found.table.loc["by hand", "log-MSE"] - 0.1
    assert (
        found.latex == rf"\dot{{v}} = F_{{\mathrm{{e}},v}} - {abs(one.value):.{_digits(one)}f} \, \left|v\right| \, v"
    )


def _digits(one):
    return 1 - int(np.floor(np.log10(one.error)))


@pytest.mark.slow
def test_the_resistance_of_a_circuit_is_a_constant_once_the_inductance_is_known():
    ranges, t = ({"L": (1.0, 3.0), "C": (0.5, 1.5)}, {"R": (2.0, 2.0)}), np.arange(41) * 0.1
    train, validation = (
        ea.simulate(ea.RLC(), *ranges, n=16, t=t, noise=0.01, seed=1, name=name) for name in ("train", "validation")
    )
    prior = {"L": (0.5, 5.0), "C": (0.3, 2.5)}
    model = ea.least_squares(ea.RLC(), train, observed_s=SEEN, prior=prior, noise=0.01)
    found = explain(model, train, validation, by_parameters=True)
    (one,) = found.coefficients
    assert str(one.term) == "I: I/L" and one.shared
    assert one.value == pytest.approx(-2.0, abs=4 * one.error)


def test_the_equation_is_a_model_like_any_other(sets, expert, found, tmp_path):
    _, validation = sets
    window, t = validation.seen[:, : found.model.observed], validation.t
    forecast = found.model.forecast(window, t)
    scores = ea.evaluate({"expert": expert, "equation": found.model}, validation)
    of = scores.loc[scores["metric"] == "log_mse_sum"].set_index("label")["value"]
    assert of["equation"] < of["expert"] - 1
    assert of["equation"] == pytest.approx(found.table.loc["equation", "log-MSE"], abs=0.05)
    found.model.save(tmp_path / "model.safetensors")
    again = ea.load(tmp_path / "model.safetensors")
    np.testing.assert_array_equal(again[0].forecast(window, t).y, forecast.y)


def test_an_equation_that_is_written_as_a_class_is_the_same(sets, found, tmp_path, monkeypatch):
    (tmp_path / "written_as_a_class.py").write_text(found.source("RubbedPendulum"))
    monkeypatch.syspath_prepend(tmp_path)
    import written_as_a_class

    system = written_as_a_class.RubbedPendulum()
    assert [p.name for p in system.expert_parameters] == ["omega0", "c0"]
    y = torch.from_numpy(sets[0].y[:, 3]).double()
    z_e, own = torch.full((len(y), 1), 2.0).double(), torch.full((len(y), 1), -0.3).double()
    decoder = found.model.stored.model
    context = decoder.interaction.context(own, z_e)
    rate = decoder.system.expert(torch.tensor(0.0), y, z_e) + decoder.interaction(y, context)
    torch.testing.assert_close(system.expert(torch.tensor(0.0), y, torch.cat((z_e, own), -1)), rate)
    torch.testing.assert_close(system.energy(y, torch.cat((z_e, own), -1)), decoder.system.energy(y, z_e))
    model = fitted(sets[0], system, prior={"omega0": (1.0, 3.5), "c0": (-0.7, 0.0)})
    assert np.allclose(model.forecast(sets[0].seen[:, : model.observed], T).z_e["c0"], -sets[0].z_a[:, 0], atol=0.15)


@pytest.mark.slow
def test_a_term_may_be_a_function(sets, tmp_path):
    drag = ea.Term("omega", "my drag", lambda values: -values["omega"])
    found = explain(fitted(sets[0]), *sets, only=["omega: cos(theta)"], extra=[drag])
    assert found.terms == (drag,)
    assert found.coefficients[0].value == pytest.approx(sets[0].z_a.mean(), abs=0.03)
    with pytest.raises(InputError, match="cannot describe this"):
        found.model.save(tmp_path / "model.safetensors")
    with pytest.raises(InputError, match="is a function"):
        found.source("Dragged")


@pytest.mark.slow
def test_a_constant_that_drifts_is_no_law():
    # Slow and fast motion of the same cubic friction: a linear one fits either, with another constant.
    class Cubic(Spring):
        def truth(self, t, y, z_e, z_a):
            drag = z_a[..., 0] * y[..., 1] ** 3
            return self.expert(t, y, z_e) - torch.stack((torch.zeros_like(drag), drag), dim=-1)

        def __init__(self, size=1.0):
            self.size = size

        def sample_initial_state(self, n, generator):
            return self.size * super().sample_initial_state(n, generator)

    ranges = {"k": (4.0, 4.0)}, {"c": (0.03, 0.03)}
    train, validation = (
        ea.simulate(Cubic(size), *ranges, n=16, t=T, noise=NOISE, name=name)
        for size, name in ((0.6, "train"), (0.8, "validation"))
    )
    model = fitted(train, Spring(), prior={"k": (2.0, 8.0)}, units={"k": "shared"})
    (wrong,) = explain(model, train, validation, only=["v: v"]).coefficients
    assert wrong.drift > 3 and wrong.verdict == "correction, not law"
    (right,) = explain(model, train, validation, only=["v: v", "v: v**3"]).coefficients
    assert str(right.term) == "v: v**3" and right.verdict == "law"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"by_hand": ["omega: speed"]}, "names 'speed'"),
        ({"components": ["speed"]}, r"components: names 'speed'; known: theta, omega"),
        ({"units": {"alpha": "shared"}}, "units.alpha"),
        ({"by_hand": ["omega: log(-1 - omega**2)"]}, "zero everywhere or not finite"),
    ],
)
def test_bad_input_is_told_in_a_line(sets, expert, options, says):
    with pytest.raises(InputError, match=says):
        explain(expert, *sets, **options)


@pytest.mark.slow
@pytest.mark.skipif(not REAL.exists(), reason="the real pendulum's measurements are not here")
@pytest.mark.parametrize(("reverse", "limit"), [(True, -7.4), (False, -8.3)])
def test_the_real_pendulums_speed_column_is_found_to_be_off(reverse, limit):
    sets = ea.split_measurements(
        REAL,
        ea.DampedPendulum(),
        split={"by": "time", "reverse": reverse, "train_share": 0.5, "validation_share": 0.2, "test_share": 0.3},
        names=["trial", "time", "angle", "speed"],
        time="time",
        trajectory="trial",
        columns={"theta": "angle", "omega": "speed"},
        length=61,
        stride=2,
        evaluation_stride=4,
        min_chunks=8,
    )
    prior, units = {"omega0": (0.9, 1.5)}, {"omega0": "shared"}
    model = ea.least_squares(
        ea.DampedPendulum(), sets["train"], observed_s=4.0, prior=prior, noise="estimated", units=units
    )
    rates = {"theta": ["omega", "cos(theta)*omega"], "omega": ["1", "omega", "abs(omega)*omega"]}
    only = [f"{rate}: {text}" for rate, texts in rates.items() for text in texts]
    found = explain(model, sets["train"], sets["validation"], only=only)
    of = {str(one.term): one.value for one in found.coefficients}
    assert of["theta: omega"] == pytest.approx(0.051, abs=0.006)
    scores = found.model.evaluate(sets["test"]).set_index("metric")["value"]
    assert scores["log_mse_sum"] < limit


@pytest.mark.parametrize("gain", [0.9, 1.0])
def test_a_speed_that_is_not_the_angles_slope_is_told(gain, caplog):
    t = np.arange(41) * 0.1
    data = ea.simulate(ea.DampedPendulum(), {"omega0": (2, 2)}, {"alpha": (0, 0)}, n=12, t=t, noise=0.005)
    y = data.y.copy()
    y[..., 1] *= gain
    sets = [ea.Trajectories(t, y[part], data.z_e[part]) for part in (slice(8), slice(8, 12))]
    model = ea.least_squares(
        ea.DampedPendulum(), sets[0], observed_s=2.0, prior={"omega0": (1, 3)}, noise=0.005, units={"omega0": "shared"}
    )
    caplog.clear()
    explain(model, *sets, only=["omega: omega"])
    assert ("of the slope of theta" in caplog.text) == (gain != 1.0)
