"""The stage evaluate on a tiny trained pendulum."""

import ast
import itertools
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
import torch
from evaluated_pendulum import DATA, asked

import tiny
from expertaug.errors import InputError, SolveError
from expertaug.evaluation import evaluate as evaluation_module
from expertaug.evaluation import score
from expertaug.evaluation.evaluate import run_stage as evaluate
from expertaug.evaluation.forecasting import forecast
from expertaug.evaluation.forecasts import Forecasts, read_forecasts
from expertaug.evaluation.samples import Samples
from expertaug.evaluation.settings import Scoring
from expertaug.evaluation.tabulate import run_stage as tabulate
from expertaug.models import store
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.systems.settings import SolverSettings
from expertaug.systems.solvers.solver import Solver
from expertaug.trajectories import SetFolder, Trajectories
from nightly import others_slow
from seen import seen

ALONE = ["test"]  # where the other sets would say the same


def run(folder, model="model", start="y0", samples=2, sets=None, **evaluation):
    outputs = [folder / f"{model}.csv", folder / f"{model}.npz"]
    job = asked(model, model, Scoring(samples=samples, **evaluation), start, **({"sets": sets} if sets else {}))
    evaluate(folder / f"{model}.safetensors", folder, *outputs, job)
    table = pd.read_csv(outputs[0])
    return table.set_index(["seed", "set", "metric"])["value"], Forecasts.load(outputs[1])


class Asked(SetFolder):
    """Sets that say in which order they were read."""

    def __init__(self, folder):
        super().__init__(folder)
        self.names = []

    def __getitem__(self, name):
        self.names.append(name)
        return super().__getitem__(name)


def test_in_memory_it_gives_what_the_stage_writes_and_asks_for_a_set_at_a_time(folder):
    _, written = run(folder)
    job = asked("model", "model", Scoring(samples=2))
    sets = Asked(folder)
    evaluation = evaluation_module.evaluate(store.load(folder / "model.safetensors"), sets, job)
    assert sets.names == job.sets, "none is read twice"
    rows = {(row.seed, row.set, row.metric): row.value for row in evaluation.rows if row.metric != "estimate_ms"}
    table = pd.read_csv(folder / "model.csv").query("metric != 'estimate_ms'")
    assert rows == table.set_index(["seed", "set", "metric"])["value"].to_dict()
    evaluation.forecasts.save(folder / "again.npz")
    assert (folder / "again.npz").read_bytes() == (folder / "model.npz").read_bytes()
    assert written.kept.keys() == evaluation.forecasts.kept.keys()


def test_a_refined_version_has_the_constants_that_its_windows_share(folder):
    """Fitted to the training windows, one of each seed; of other windows no other value is asked."""
    settings = RefinementSettings(units={"omega0": "shared"}, starts=8)
    how = Refinement.of(settings=settings, noise=0.01, prior={"omega0": [1.5, 3.1]})
    job = asked("a~refined", "a, refined", Scoring(samples=2), refinement=how, sets=ALONE)
    found = evaluation_module.evaluate(store.load(folder / "model.safetensors"), SetFolder(folder), job)
    assert found.forecasts.shared.keys() == {"omega0"}
    estimates = found.forecasts.sets["test"].z_e_hat
    assert np.ptp(estimates[..., 0], axis=-1) == pytest.approx(0.0, abs=1e-6)
    assert 1.5 < estimates[..., 0].mean() < 3.1


def test_a_model_without_the_expert_has_no_parameter_error(folder, tmp_path):
    """Its z_e is not an estimate of anything: tables print a dash, figures leave it out."""
    values, forecasts = run(folder, "ml_only")
    metrics = {metric for *_, metric in values.index}
    assert "log_mse_sum" in metrics and not any("omega0" in m or m == "relative_error" for m in metrics)
    assert forecasts.estimates == {}
    run(folder)
    files = [folder / f"{name}.csv" for name in ("model", "ml_only")]
    tabulate(files, [tmp_path / "table.md"], {}, [folder / "model.npz"])
    first = (tmp_path / "table.md").read_text().split("\n\nLog-MSE of the worst seed")[0]
    cells = {line.split(" | ")[0]: line.split(" | ")[1:] for line in first.splitlines()}
    heads = cells["| method"]
    errors = [k for k, head in enumerate(heads) if "error [%]" in head]
    assert errors and all(cells["| ml_only"][k].rstrip(" |") == "–" for k in errors)
    assert all(cells["| model"][k].rstrip(" |") != "–" for k in errors)


def test_metrics_of_every_seed_and_set_follow_from_the_forecasts(folder):
    values, forecasts = run(folder, samples=12)
    assert {seed for seed, *_ in values.index} == {4, 7}
    assert forecasts.observed == 10 and forecasts.parameter_units == ["rad/s"]
    for place, seed in enumerate([4, 7]):
        error = (forecasts.kept["test"].prediction[place] - forecasts.kept["test"].truth) ** 2
        index = forecasts.kept["test"].index
        assert len(set(index.tolist())) >= 10
        late = error[:, 11:].sum(-1).mean()
        assert values[seed, "test", "log_mse_sum"] == pytest.approx(np.log(late), abs=0.4)
        wrong = np.abs(forecasts.estimates["test"][place] / forecasts.truths["test"] - 1)
        assert values[seed, "test", "relative_error"] == pytest.approx(100 * wrong.mean(), rel=1e-4)
    assert values[4, "test", "log_mse_sum"] - values[4, "test", "log_mse_dim"] == pytest.approx(np.log(2))


def test_forecasts_carry_where_their_samples_come_from(folder, tmp_path):
    assert all(kept.id is None for kept in run(folder)[1].kept.values())
    for name in DATA.sets:
        one = Trajectories.load(folder / f"{name}.npz")
        names = None if name == "train" else np.array([f"r{k % 3}/{10 * k}" for k in range(len(one))])
        Trajectories(one.t, one.y, one.z_e, one.z_a, names).save(tmp_path / f"{name}.npz")
    (tmp_path / "model.safetensors").write_bytes((folder / "model.safetensors").read_bytes())
    forecasts = run(tmp_path, samples=3, max_samples=9)[1]
    truth = Trajectories.load(tmp_path / "test.npz")
    own = {str(name): y for name, y in zip(truth.id, truth.y, strict=True)}
    assert set(forecasts.kept) == {"validation", "test"}
    arrays = np.load(tmp_path / "model.npz")
    assert list(arrays["test_sample_id"]) == list(truth.id[np.linspace(0, 11, 9).astype(int)])
    assert "train_sample_id" not in arrays
    for name, y in zip(forecasts.kept["test"].id, forecasts.kept["test"].truth, strict=True):
        np.testing.assert_array_equal(y, own[str(name)])


def test_parts_of_a_set_give_the_metrics_of_the_whole(folder, monkeypatch):
    whole, kept = run(folder, samples=3, sets=ALONE)
    monkeypatch.setattr("expertaug.evaluation.score.CHUNK_BYTES", 5 * 21 * 2 * 4 * 2)  # five samples of two seeds
    parts, again = run(folder, samples=3, sets=ALONE)
    whole, parts = (one[one.index.get_level_values("metric") != "estimate_ms"] for one in (whole, parts))
    np.testing.assert_allclose(parts, whole, rtol=1e-3)
    np.testing.assert_allclose(again.kept["test"].prediction, kept.kept["test"].prediction, atol=2e-3)
    np.testing.assert_array_equal(again.kept["test"].index, kept.kept["test"].index)


def test_what_an_estimate_costs_is_told_for_each_window(folder, monkeypatch):
    """Processor time by the window and seed, without that of the forecast."""
    clock = itertools.count(10.0, 0.6)
    monkeypatch.setattr("expertaug.evaluation.forecasting.time.process_time", lambda: next(clock))
    values, _ = run(folder)
    sizes = {name: len(Trajectories.load(folder / f"{name}.npz")) for name in ("train", "test")}
    for seed in (4, 7):
        for name, size in sizes.items():
            assert values[seed, name, "estimate_ms"] == pytest.approx(600 / (2 * size))
    assert "estimate_ms" not in run(folder, "mean")[0].index.get_level_values("metric")


def test_further_sets_are_scored_but_no_forecasts_kept(folder):
    (folder / "near.npz").write_bytes((folder / "test.npz").read_bytes())
    outputs = folder / "further.csv", folder / "further.npz"
    sets = ["train", "validation", "test", "near"]
    evaluate(folder / "model.safetensors", folder, *outputs, asked(sets=sets))
    table = pd.read_csv(outputs[0]).set_index(["seed", "set", "metric"])["value"]
    assert table[4, "near", "log_mse_sum"] == table[4, "test", "log_mse_sum"]
    assert list(Forecasts.load(outputs[1]).kept) == ["validation", "test"]


def test_errors_of_every_sample_are_kept_and_give_the_metrics(folder):
    (folder / "near.npz").write_bytes((folder / "test.npz").read_bytes())
    outputs = folder / "kept.csv", folder / "kept.npz"
    sets = ["train", "validation", "iid", "test", "near"]
    evaluate(folder / "model.safetensors", folder, *outputs, asked(label="A", sets=sets))
    values = pd.read_csv(outputs[0]).set_index(["seed", "set", "metric"])["value"]
    arrays = np.load(outputs[1])
    assert list(arrays["version"]) == ["pendulum", "corrected", "a"]
    for name in sets:
        errors = arrays[f"{name}_errors"]
        assert errors.shape == (2, 12)
        for place, seed in enumerate([4, 7]):
            assert np.log(errors[place].mean()) == pytest.approx(values[seed, name, "log_mse_sum"], abs=1e-5)
        assert arrays[f"{name}_z_e"].shape == (12, 1) and (f"{name}_z_e_hat" in arrays) == (name != "train")
    wrong = np.abs(arrays["near_z_e_hat"] / arrays["near_z_e"] - 1)
    assert 100 * wrong[1].mean() == pytest.approx(values[7, "near", "relative_error"], rel=1e-4)
    assert "iid_truth" in arrays and "near_truth" not in arrays
    samples = Samples(read_forecasts(outputs[1:]))
    for metric in ("log_mse_sum", "log_mse_median", "relative_error", "relative_error_omega0"):
        found = samples.resampled(("pendulum", "corrected", "a"), "iid", metric)
        assert found.value == pytest.approx([values[seed, "iid", metric] for seed in (4, 7)], rel=1e-4)
    assert samples.resampled(("pendulum", "corrected", "a"), "train", "relative_error") is None
    iid, validation = (np.load(folder / f"{name}.npz")["y"] for name in ("iid", "validation"))
    assert not np.isin(iid[:, 0, 0], validation[:, 0, 0]).any(), "draws of its own"


def test_the_metric_can_see_the_whole_trajectory(folder):
    late, _ = run(folder, sets=ALONE)
    whole, _ = run(folder, from_s=0.0, sets=ALONE)
    assert whole[4, "test", "log_mse_sum"] < late[4, "test", "log_mse_sum"], "the first point is known"


def test_times_after_the_observed_window_are_also_scored_alone(folder):
    late, _ = run(folder)
    whole, _ = run(folder, from_s=0.0)
    assert not [name for *_, name in late.index if "after" in name]
    for seed in (4, 7):
        for name in ("train", "validation", "test"):
            for convention in ("sum", "dim"):
                after = whole[seed, name, f"log_mse_after_{convention}"]
                assert after == pytest.approx(late[seed, name, f"log_mse_{convention}"], abs=1e-6)


def test_longer_sets_are_forecast_from_the_same_windows(folder):
    """Samples of them are those of other sets, so that errors of single ones are kept of these alone."""
    tiny.simulated(folder, DATA.model_copy(update={"t2_s": 4.0, "sets": {"long": tiny.swings(12)}}))
    outputs = folder / "long.csv", folder / "long_forecasts.npz"
    job = asked(sets=["test", "long"])
    evaluate(folder / "model.safetensors", folder, *outputs, job)
    values = pd.read_csv(outputs[0]).set_index(["seed", "set", "metric"])["value"]
    stored, truth = store.load(folder / "model.safetensors"), Trajectories.load(folder / "long.npz")
    y = torch.from_numpy(truth.y).movedim(1, 0).unsqueeze(1).expand(-1, 2, -1, -1)
    with torch.no_grad():
        states, _ = stored.model.predict(seen(y[:11], torch.from_numpy(truth.t).float()), stored.solver)
    expected = (states - y)[11:].double().square().sum(-1).mean((0, 2)).log()
    assert [values[s, "long", "log_mse_sum"] for s in (4, 7)] == pytest.approx(expected.tolist(), abs=1e-3)
    arrays = np.load(outputs[1])
    assert len(arrays["t"]) == 21 and "long_errors" not in arrays and "test_errors" in arrays


def test_a_longer_forecast_may_go_as_far_as_it_is_long(folder, monkeypatch):
    """The bound is for the training's 2 s: an angle that turns goes twice as far in 4 s."""
    data = Trajectories.load(folder / "test.npz")
    Trajectories(2 * data.t, data.y, data.z_e, data.z_a).save(folder / "slow.npz")
    save_as(folder, "far", lambda model: {"bound": [100.0, 50.0]})
    limits = []
    monkeypatch.setattr(score, "forecast", lambda *args: (limits.append(args[4]), forecast(*args))[1])
    outputs = folder / "slow.csv", folder / "slow_forecasts.npz"
    evaluate(folder / "far.safetensors", folder, *outputs, asked(sets=["test", "slow"]))
    found = [limit.flatten(0, -2).amax(0).tolist() for limit in limits]
    assert found == [[100.0, 50.0], [200.0, 100.0]]


def test_a_forecast_from_the_last_observed_point_shows_the_observation(folder):
    _, forecasts = run(folder, start="y_t1", sets=ALONE)
    np.testing.assert_allclose(
        forecasts.kept["test"].prediction[0, :, :11], forecasts.kept["test"].truth[:, :11], atol=1e-6
    )


def test_the_mean_has_no_parameters(folder):
    values, forecasts = run(folder, "mean", sets=ALONE)
    assert not [metric for *_, metric in values.index if "error" in metric]
    assert forecasts.estimates == {}
    assert np.ptp(forecasts.kept["test"].prediction, axis=1).max() == 0


def test_the_same_evaluation_gives_the_same_bytes(folder):
    def made() -> tuple[list[str], bytes]:
        run(folder, sets=ALONE)
        lines = (folder / "model.csv").read_text().splitlines()
        return [line for line in lines if "estimate_ms" not in line], (folder / "model.npz").read_bytes()

    assert made() == made()


@pytest.mark.slow
def test_an_evaluation_needs_neither_figures_nor_a_store():
    """They cost more to import than it takes; one job draws and stores all of an experiment's."""
    code = "import sys, expertaug.evaluation.evaluate as e; print({n.split('.')[0] for n in sys.modules})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"matplotlib", "mlflow", "pandas", "scipy"} & set(ast.literal_eval(done.stdout))


@pytest.mark.parametrize(
    "stage", others_slow(["tabulate", "studies", "alarms", "coverage", "distance", "plot", "dots", "published"])
)
def test_what_reads_evaluations_does_without_torch(stage):
    """Its import takes longer than they do."""
    code = f"import sys, expertaug.evaluation.{stage}; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_other_seeds_are_refused(folder):
    with pytest.raises(InputError, match=r"holds seeds \[4, 7\].*expected \[1\]"):
        evaluate(folder / "model.safetensors", folder, folder / "x.csv", folder / "x.npz", asked(seeds=[1]))
    assert not (folder / "x.csv").exists()


def save_as(folder, name, change):
    """The trained model after ``change(model)``, with what ``change`` returns added to its description."""
    stored = store.load(folder / "model.safetensors")
    more = change(stored.model) or {}
    store.save(folder / f"{name}.safetensors", stored.model, stored.card.but(**more))


def test_forecasts_that_are_not_finite_count_at_the_bound(folder):
    def break_second_seed(model):
        model.interaction.rest.layers[-1].bias.data[1] = 3e38  # its forecasts overflow

    save_as(folder, "broken", break_second_seed)
    values, forecasts = run(folder, "broken", sets=ALONE, solver=SolverSettings(method="rk4"))
    good, _ = run(folder, sets=ALONE, solver=SolverSettings(method="rk4"))
    assert values[4, "test", "runaway_share"] == 0 and values[7, "test", "runaway_share"] == 1
    assert values[4, "test", "log_mse_sum"] == good[4, "test", "log_mse_sum"]
    assert np.isfinite(values).all() and np.isfinite(forecasts.kept["test"].prediction).all()
    bound = 10 * np.abs(np.load(folder / "train.npz")["y"]).max((0, 1))
    truth = np.load(folder / "test.npz")["y"][:, 11:].astype(float)
    assert values[7, "test", "log_mse_sum"] == pytest.approx(np.log(((truth - bound) ** 2).sum(-1).mean()), abs=1e-5)


def test_a_solver_that_gives_up_on_one_sample_costs_that_sample_alone(folder, monkeypatch):
    """The adaptive solver refuses every batch with the test set's sixth sample."""
    whole, _ = run(folder, sets=ALONE)
    refused, solve = np.load(folder / "test.npz")["y"][5, 0], Solver.__call__

    def refusing(self, f, y0, t, flow=None, rank=1, **options):
        if self.method == "dopri5" and (y0 == torch.from_numpy(refused)).all(-1).any():
            raise SolveError("dopri5 failed (underflow in dt)")
        return solve(self, f, y0, t, flow, rank, **options)

    monkeypatch.setattr(Solver, "__call__", refusing)
    values, forecasts = run(folder, samples=12, sets=ALONE)
    assert values[4, "test", "runaway_share"] == pytest.approx(1 / 12)
    assert values[4, "test", "log_mse_sum"] == pytest.approx(whole[4, "test", "log_mse_sum"], abs=0.05)
    assert np.isfinite(forecasts.kept["test"].prediction).all()


@pytest.mark.slow
def test_the_truth_itself_is_no_runaway(folder):
    """Of samples that reach beyond the bound a forecast is kept as far as the truth goes."""
    save_as(folder, "tight", lambda model: {"bound": [1e-3, 1e-3]})
    values, forecasts = run(folder, "tight", samples=12)
    largest = np.abs(forecasts.kept["test"].truth).max(1)
    assert (np.abs(forecasts.kept["test"].prediction).max(2) <= largest * (1 + 1e-6)).all()
    assert 0 <= values[4, "test", "runaway_share"] < 1


def test_a_model_file_from_before_there_was_a_bound(folder):
    def break_it(model):
        model.interaction.rest.layers[-1].bias.data[1] = 3e38  # its forecasts overflow
        return {"bound": None}

    save_as(folder, "old", break_it)
    values, _ = run(folder, "old", solver=SolverSettings(method="rk4"))
    assert np.isfinite(values[4]).all() and np.isnan(values[7, "test", "log_mse_sum"])
    assert values[7, "test", "runaway_share"] == 1


def test_a_seed_that_could_not_be_trained_has_no_values(folder):
    save_as(folder, "failed", lambda model: {"failed": [4]})
    values, forecasts = run(folder, "failed")
    assert np.isnan(values[4].drop(("train", "wall_s"))).all() and np.isfinite(values[7]).all()
    assert forecasts.failed == [4]
    errors = np.load(folder / "failed.npz")["test_errors"]
    assert np.isnan(errors[0]).all() and np.isfinite(errors[1]).all()
    assert forecasts.sets["test"].median is None, "one seed is left"


def test_the_median_of_the_seeds_forecasts_is_scored(folder):
    _, forecasts = run(folder, samples=12, sets=ALONE)
    kept, observed = forecasts.kept["test"], forecasts.observed + 1
    middle = np.median(kept.prediction, axis=0)[:, observed:]
    error = ((middle - kept.truth[:, observed:]) ** 2).sum(2).mean(1)
    np.testing.assert_allclose(forecasts.sets["test"].median[kept.index], error, rtol=1e-4)
    states = torch.tensor([4.0, 1.0, np.nan, 2.0, 3.0]).view(1, -1, 1, 1)
    assert score.median_of_seeds(states).item() == 3 and score.median_of_seeds(states[:, [0, 1, 3, 4]]).item() == 2.5
