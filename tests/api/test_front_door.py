"""The names that `import expertaug` gives, and what they refuse."""

import ast
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from small_pendulum import ENCODER, INTERACTION, OPTIONS, SEEN, SHIFTED, T

import expertaug as ea

ROOT = Path(__file__).parents[2]


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, expertaug as ea; dir(ea); print(*sorted({m.split('.')[0] for m in sys.modules}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"torch", "numpy", "pandas", "matplotlib", "scipy", "mlflow", "pydantic"} & set(done.stdout.split())


def test_every_name_is_there_and_has_a_type():
    stub = ast.parse((ROOT / "src/expertaug/__init__.pyi").read_text(encoding="utf-8"))
    typed = {}
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            typed |= {alias.asname or alias.name: f"{node.module}:{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Assign):
            assert set(ast.literal_eval(node.value)) == {"__version__", *ea._EXPORTS}
    assert typed.keys() == ea._EXPORTS.keys()
    for name, where in ea._EXPORTS.items():
        assert typed[name] == where if ":" in where else typed[name].replace(":", ".") == where
        assert getattr(ea, name) is not None and name in dir(ea)
    with pytest.raises(AttributeError, match="fitt"):
        _ = ea.fitt


def test_training_options_are_those_of_the_trainer():
    from expertaug.api.training import TrainingOptions
    from expertaug.learning.settings import TrainSettings

    given_otherwise = {"checkpoint_s", "objective", "solver", "horizon_s"}
    assert set(TrainingOptions.__annotations__) == set(TrainSettings.model_fields) - given_otherwise


def test_options_of_flows_and_alternation_are_those_of_their_settings():
    from expertaug.api.inference import AlternatingOptions
    from expertaug.api.posterior import FlowOptions
    from expertaug.inference.settings import AlternatingSettings, FlowSettings

    for options, settings in ((FlowOptions, FlowSettings), (AlternatingOptions, AlternatingSettings)):
        assert set(options.__annotations__) == set(settings.model_fields) - {"checkpoint_s"}


def test_classes_and_mappings_make_the_same_model(sets, recipe, fit):
    encoder = partial(ea.RecurrentEncoder, hidden=8, layers=[8])
    other = ea.HybridModel(ea.DampedPendulum(), encoder, partial(ea.MLPInteraction, layers=(6, 6)))
    again = ea.fit(other, sets["train"], sets["validation"], observed_s=1.0, seeds=(0, 1), **OPTIONS)
    first, second = (model.stored.model.state_dict() for model in (fit, again))
    assert all(torch.equal(first[k], second[k]) for k in first)
    assert again.stored.card.model.encoder["kind"] == "recurrent"


def test_the_course_of_the_training_is_kept(fit):
    loss = fit.history[fit.history["metric"] == "loss"]
    assert list(loss["seed"]) == [0, 1] * 3 and np.isfinite(loss["value"]).all()
    assert {"validation_score", "learning_rate"} <= set(fit.history["metric"])


class TestForecast:
    def test_numpy_in_numpy_out_and_torch_in_torch_out(self, fit, sets):
        window = sets["test"].y[:, :11]
        found = fit.forecast(window, T)
        assert isinstance(found.y, np.ndarray) and found.y.shape == (2, 10, 21, 2)
        assert found.z_e["omega0"].shape == (2, 10) and found.units["z_e omega0"] == "rad/s"
        same = fit.forecast(torch.from_numpy(window), torch.from_numpy(T))
        assert isinstance(same.y, torch.Tensor) and isinstance(same.z_e["omega0"], torch.Tensor)
        np.testing.assert_array_equal(same.y.numpy(), found.y)
        np.testing.assert_array_equal(ea.forecast(fit, window.astype(float), list(T)).y, found.y)

    def test_one_seed_of_the_group(self, fit, sets):
        window = sets["test"].y[:, :11]
        rk4 = ea.Solver("rk4")  # an adaptive one takes steps that suit all of a group
        whole = fit.forecast(window, T, solver=rk4)
        assert len(fit) == 2 and [one.seeds for one in fit] == [[0], [1]]
        for k, one in enumerate(fit):
            alone = one.forecast(window, T, solver=rk4)
            assert alone.y.shape == (10, 21, 2) and alone.z_e["omega0"].shape == (10,)
            np.testing.assert_allclose(alone.y, whole.y[k], atol=1e-5)
            np.testing.assert_allclose(one.estimate(window, T[:11])["omega0"], whole.z_e["omega0"][k], rtol=1e-5)
        assert fit[-1].seeds == [1] and fit[:1].forecast(window, T).y.shape == (1, 10, 21, 2)
        assert set(fit[1].history["seed"]) == {1} and fit[1].evaluate(sets["test"])["seed"].unique().tolist() == [1]
        with pytest.raises(IndexError):
            fit[2]

    def test_any_times_may_follow_the_window(self, fit, sets):
        window = sets["test"].y[:, :11]
        later = np.concatenate((T[:11], [1.55, 3.0, 7.0]))
        found = fit[0].forecast(window, later)
        assert found.y.shape == (10, 14, 2) and np.isfinite(found.y).all()
        np.testing.assert_array_equal(fit[0].forecast(window, T, start="y_t1").y[:, :11], window)

    def test_without_the_expert_there_are_no_estimates(self, sets):
        agnostic = ea.HybridModel(ea.DampedPendulum(), ENCODER, INTERACTION, expert=False)
        found = ea.fit(agnostic, sets["train"], sets["validation"], observed_s=1.0, **OPTIONS | {"epochs": 1})
        window = sets["test"].y[:, :11]
        assert found.estimate(window, T[:11]) == {} and found.forecast(window, T).z_e == {}
        assert "relative_error" not in set(found.evaluate(sets["test"])["metric"])

    def test_the_expert_forecasts_with_the_estimates(self, sets, recipe):
        alone = ea.HybridModel(ea.DampedPendulum(), ENCODER)
        model = ea.fit(alone, sets["train"], sets["validation"], observed_s=1.0, epochs=1)
        found = model[0].forecast(sets["test"].y[:3, :11], T)
        z_e = torch.from_numpy(found.z_e["omega0"]).unsqueeze(-1)
        expert = model.solver(
            lambda s, y: ea.DampedPendulum().expert(s, y, z_e),
            torch.from_numpy(found.y[:, 0]),
            torch.from_numpy(T).float(),
        )
        np.testing.assert_allclose(found.y, expert.movedim(0, 1).numpy(), atol=1e-6)

    @pytest.mark.parametrize(
        ("change", "t", "expected"),
        [
            (lambda y: y[0], T, r"window: has shape \(11, 2\); give \(N, 11, 2\): the state is theta, omega"),
            (lambda y: y[..., :1], T, r"window: has shape \(10, 11, 1\)"),
            (lambda y: y[:, :9], T, r"window: has the times 0, 0.1 … 0.8 s \(9 points\); the model knows 0, 0.1 … 1 s"),
            (lambda y: y, T * 2, r"window: has the times 0, 0.2 … 2 s"),
            (lambda y: y, T + 5, "window: has the times 5, 5.1"),
            (lambda y: y, T[:5], "window: has the times"),
            (lambda y: y, T[::-1], "t: does not increase"),
            (lambda y: np.where(y == y[3, 2, 1], np.nan, y), T, r"window: is not finite, first at index \(3, 2, 1\)"),
            (lambda y: [["a"]], T, "window: no array of numbers"),
        ],
    )
    def test_a_window_of_another_sampling_is_refused_in_one_line(self, fit, sets, change, t, expected):
        with pytest.raises(ea.InputError, match=expected) as caught:
            fit.forecast(change(sets["test"].y[:, :11]), t)
        assert "\n" not in str(caught.value)


class TestRefusals:
    @pytest.mark.parametrize(
        ("options", "expected"),
        [
            ({"observed_s": 9.0}, "observed_s: found 9.0; the data's times are 0, 0.1 … 2 s"),
            ({"observed_s": 0.0}, "observed_s"),
            ({"epoch": 3}, "training.*epoch"),
            ({"seeds": []}, "seeds: found"),
            ({"seeds": [1, 1]}, "seeds: found"),
            ({"seeds": 3}, "seeds: found 3"),
            ({"seeds": [-1]}, "seeds: found"),
            ({"seeds": [0.5]}, r"seeds: found \[0.5\]; give whole numbers"),
            ({"seeds": [True]}, r"seeds: found \[True\]"),
            ({"start": {"thta": (0, 1)}}, "start.thta: 'thta' is no component of the state; did you mean 'theta'?"),
            ({"device": "gpu"}, "device: found 'gpu'; did you mean 'cuda'?"),
            ({"solver": "rk4"}, r"solver: found 'rk4'; give one, as expertaug.Solver\(.rk4.\)"),
            ({"forecast_solver": "rk4"}, "forecast_solver: found 'rk4'"),
            ({"horizon_s": "1"}, "training.horizon_s: found '1'"),
            ({"horizon_s": 100.0}, "training.horizon_s: found 100; the data end at "),
            ({"label": 3}, "^label: found 3; give a text"),
            ({"objective": ea.DampedPendulum}, "objective: the class DampedPendulum is no Objective"),
            ({"preset": "best"}, "preset"),
            ({"choices": {"colour": "red"}}, "choices.colour"),
            ({"objective": ea.HybridVAE}, "prior: missing, HybridVAE needs it"),
            ({"objective": lambda *a: None}, "objective: found function .*lambda"),
            ({"prior": {"omega": (0, 1)}}, "prior: gives omega; give .* omega0"),
        ],
    )
    def test_of_fit(self, sets, recipe, options, expected):
        with pytest.raises(ea.InputError, match=expected) as caught:
            ea.fit(recipe, sets["train"], sets["validation"], **({"observed_s": 1.0} | options))
        assert "\n" not in str(caught.value)

    def test_of_sets(self, sets, recipe, fit):
        good = sets["validation"]
        short = ea.Trajectories(good.t[:20], good.y[:, :20], good.z_e)
        other = ea.simulate(ea.RLC(), {"L": (1, 2), "C": (1, 2)}, {"R": (1, 2)}, n=3, t=T)
        for wrong, expected in (
            (short, "validation: has the times"),
            (other, "validation: y has shape"),
            (good.y, "validation: is ndarray; give expertaug.Trajectories"),
        ):
            with pytest.raises(ea.InputError, match=expected):
                ea.fit(recipe, sets["train"], wrong, observed_s=1.0)
        with pytest.raises(ea.InputError, match="model: is DampedPendulum"):
            ea.fit(ea.DampedPendulum(), sets["train"], good, observed_s=1.0)
        with pytest.raises(ea.InputError, match="train: has the times"):
            ea.augment(fit, short, short, prior=SHIFTED)
        with pytest.raises(ea.InputError, match="window"):
            fit.evaluate(ea.Trajectories(good.t * 2, good.y, good.z_e))

    @pytest.mark.parametrize(
        ("options", "expected"),
        [
            ({"prior": {"alpha": (0, 1)}}, "prior: gives alpha; give .* omega0"),
            ({"prior": {"omega0": (3, 1)}}, r"prior.omega0: found \[3, 1\]"),
            ({"prior": {"omega0": 3}}, "prior.omega0: found 3"),
            ({"prior": SHIFTED, "noise": -1.0}, "noise: found -1.0"),
        ],
    )
    def test_of_finetune(self, fit, sets, options, expected):
        with pytest.raises(ea.InputError, match=expected):
            ea.finetune(fit, sets["train"], sets["validation"], **options)

    def test_of_a_control(self, fit, sets):
        samples = ea.augment(fit, sets["train"], sets["validation"], prior=SHIFTED)
        with pytest.raises(ea.InputError, match="given both control and augmented"):
            ea.finetune(fit, sets["train"], sets["validation"], augmented=samples, control=True)

    @pytest.mark.parametrize(
        ("change", "expected"),
        [
            ({"z_e": {"omega": (1, 2)}}, "parameter ranges"),
            ({"n": 0}, "n = 0"),
            ({"t": [0, 0]}, "t has shape"),
            ({"noise": -0.1}, "noise = -0.1"),
            ({"noise": "x"}, "noise = x; .* noise at least 0"),
            ({"n": "3"}, "n = 3"),
            ({"seed": -1}, "seed: found -1; give a whole number from 0 on"),
        ],
    )
    def test_of_simulate(self, change, expected):
        options = {"z_e": SEEN, "z_a": {"alpha": (0, 1)}, "n": 2, "t": T} | change
        with pytest.raises(ea.InputError, match=expected):
            ea.simulate(ea.DampedPendulum(), **options)

    def test_of_augment(self, fit, sets):
        with pytest.raises(ea.InputError, match=r"worst: found 3.0; give a share from 0 to 1"):
            ea.augment(fit, sets["train"], sets["validation"], prior=SHIFTED, worst=3.0)

    def test_of_load(self, fit, tmp_path):
        fit.save(tmp_path / "m")
        with pytest.raises(ea.InputError, match="device: found 'gpu'; did you mean 'cuda'"):
            ea.load(tmp_path / "m", device="gpu")


class TestPlotsAndMetrics:
    def test_figures_are_returned(self, fit, plus, sets):
        both = {"APHYNITY": fit, "APHYNITY+": plus}
        figure = ea.plots.forecasts(both, sets["test"], samples=[0, 4])
        assert len(figure.axes) == 4 and len(figure.axes[0].lines) == 3
        np.testing.assert_array_equal(figure.axes[1].lines[0].get_ydata(), sets["test"].y[4, :, 0])
        drawn = ea.plots.parameters(both, sets["test"], prior=SHIFTED)
        assert len(drawn.axes) == 2
        course = ea.plots.course(fit)
        assert len(course.axes[0].lines) == 2 and course.axes[1].get_ylabel() == "selection score"
        assert len(ea.plots.forecasts(fit[1], sets["test"]).axes) == 6
        with pytest.raises(ea.InputError, match="samples"):
            ea.plots.forecasts(fit, sets["test"], samples=[99])

    def test_metrics_of_arrays_are_those_of_the_tables(self, fit, sets):
        test, system = sets["test"], fit.system
        table = fit.evaluate(test).set_index(["seed", "metric"])["value"]
        found = fit.forecast(test.y[:, :11], test.t)
        score = ea.metrics.log_mse(system, found.y[:, :, 11:], test.y[:, 11:])
        np.testing.assert_allclose(score, [table[seed, "log_mse_sum"] for seed in (0, 1)], rtol=1e-6)
        errors = ea.metrics.parameter_errors(system, fit[1].estimate(test.y[:, :11], test.t), test.z_e)
        assert errors["rmse_omega0"] == pytest.approx(table[1, "rmse_omega0"], rel=1e-5)
        assert ea.metrics.log_mse(system, test.y + 1.0, test.y) == pytest.approx(np.log(2.0), abs=1e-6)

    def test_several_models_in_one_table(self, fit, plus, sets):
        table = ea.evaluate({"a": fit, "b": plus}, sets["test"], from_s=1.5, max_samples=4)
        assert list(table.columns) == ["label", "seed", "metric", "value"] and set(table["label"]) == {"a", "b"}
