"""Estimators are a registered kind: a new one is a class, and nobody compares names."""

import ast
import csv
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

import expertaug as ea
from expertaug.cli import main
from expertaug.config.load import default_files, load, validate
from expertaug.errors import InputErrors
from expertaug.models.estimators import ESTIMATORS, EstimatorKind, estimator
from expertaug.models.posterior import Estimates, Predictor
from expertaug.stages import STAGES
from nightly import others_slow

ROOT = Path(__file__).parents[2]
HOME = ROOT / "src" / "expertaug" / "models" / "estimators.py"
GROUP = "seeds_0_1_2"


class LastState(Predictor, nn.Module):
    """The last observed state, and what states have moved from theirs on the average over the training set."""

    def __init__(self, system, drift):
        super().__init__()
        self.system = system
        self.register_buffer("drift", drift)  # (T, *state)

    def estimate(self, windows):
        return Estimates(windows.y[-1], None, None)

    def forecast(self, y0, z_e, z_a, t, solver, u=None):
        return y0 + self.drift.view(len(t), *[1] * (y0.dim() - 1), -1)


class Persistence(EstimatorKind):
    """The toy: one file has all of it."""

    name = "persistence"
    summary = "the last observed state stays, but for what the training set's states drift"
    fixed_times = True

    @classmethod
    def fit(cls, system, train, card, truth=False):
        y = torch.from_numpy(train.y)
        return LastState(system, (y - y[:, card.observed - 1 : card.observed]).mean(0)), card

    @classmethod
    def network(cls, system, card, tensors, classes, base=None):
        return LastState(system, tensors["drift"])


def configured(kind):
    given = load(default_files())
    method = {"label": "Persistence", "kind": kind}
    over = {"methods": ["mean", "persistence"], "augmented": [], "controls": [], "refined": [], "flows": []}
    experiment = {**given["experiments"]["pendulum"], **over, "augmentations": {}, "studies": {}}
    sets = {name: {**values, "size": 30} for name, values in experiment["data"]["sets"].items()}
    experiment["data"] = {**experiment["data"], "sets": sets, "t2_s": 6.0}
    methods = {**given["methods"], "persistence": method}
    return {**given, "run": ["pendulum"], "methods": methods, "experiments": {"pendulum": experiment}}


def run(config, stage, *names, arguments):
    settings = STAGES[stage].settings_of(config, "pendulum", *names)
    assert main([stage, *map(str, arguments), "--settings", settings]) == 0


@pytest.mark.parametrize("kind", others_slow(["persistence", f"{__name__}:Persistence"]))
def test_a_new_kind_is_trained_saved_loaded_and_evaluated(kind, tmp_path, monkeypatch):
    if ":" not in kind:
        monkeypatch.setitem(ESTIMATORS, kind, Persistence)
    config = validate(configured(kind))
    for name in config.experiments["pendulum"].data.set_names:
        run(config, "simulate", name, arguments=[name, "--output", tmp_path / f"{name}.npz"])
    for method in ("mean", "persistence"):
        files = {name: tmp_path / f"{method}_{name}" for name in ("model", "csv", "npz", "work")}
        paths = ["--data", tmp_path, "--output", files["model"], "--work", files["work"]]
        run(config, "train", method, GROUP, arguments=paths)
        paths = ["--model", files["model"], "--data", tmp_path, "--output", files["csv"], "--forecasts", files["npz"]]
        run(config, "evaluate", method, GROUP, arguments=paths)
        with files["csv"].open(encoding="utf-8") as lines:
            rows = list(csv.DictReader(lines))
        assert {row["method"] for row in rows} == {method} and {row["seed"] for row in rows} == {"0", "1", "2"}
    model = ea.load(tmp_path / "persistence_model", classes=[Persistence])
    assert model.stored.kind is Persistence and model.stored.card.kind == kind and len(model) == 3
    test = ea.Trajectories.load(tmp_path / "test.npz")
    window = test.y[:, : model.observed]
    moved = model[0].forecast(window, test.t).y - window[:, -1:]
    np.testing.assert_allclose(moved, np.broadcast_to(model.stored.model.drift, moved.shape), atol=1e-5)
    assert len(model.evaluate(test)) and model.estimate(window, test.t[: model.observed]) == {}
    with pytest.raises(ea.InputError, match="only models with an expert"):
        model.refined()
    if ":" in kind:
        with pytest.raises(ea.InputError, match=r"needs .*:Persistence, which is not part of expertaug"):
            ea.load(tmp_path / "persistence_model")


def test_what_there_is_not_is_one_line():
    with pytest.raises(InputErrors, match=r"methods\.persistence\.kind: found 'persistance'"):
        validate(configured("persistance"))
    with pytest.raises(ea.InputError, match=r"'kalman' is no kind of estimators; .*known: hybrid, hybrid_shared"):
        estimator("kalman")
    with pytest.raises(ea.InputError, match=rf"no class 'Kalman' in {re.escape(__name__)}; correct the name"):
        estimator(f"{__name__}:Kalman")
    with pytest.raises(ea.InputError, match="the class LastState is no EstimatorKind"):
        estimator(f"{__name__}:LastState")


def compared(path: Path) -> list[str]:
    """Comparisons of a kind with the name of an estimator in a module, or a rule of the workflow."""
    text = path.read_text(encoding="utf-8")
    names = "|".join(ESTIMATORS)
    if path.suffix != ".py":
        return re.findall(rf"kind\w*[\])]*\s*(?:==|!=|in|not in)\s*[\[({{]?\s*\"(?:{names})\".*", text)
    if not re.search(rf"[\"'](?:{names})[\"']", text):
        return []
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Compare):
            named = {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)}
            found += [ast.unparse(node)] if named & set(ESTIMATORS) and "kind" in ast.unparse(node) else []
    return found


def test_nobody_compares_a_kind_with_the_name_of_an_estimator():
    modules = [path for path in (ROOT / "src").rglob("*.py") if path != HOME]
    found = {path.name: compared(path) for path in (*modules, *(ROOT / "workflow").rglob("*.smk"))}
    assert not {name: lines for name, lines in found.items() if lines}, f"ask the kind what it can do ({HOME.name})"


def test_such_comparisons_are_found(tmp_path):
    rule, module = tmp_path / "a.smk", tmp_path / "a.py"
    rule.write_text('x = [v for v in own if CONFIG.methods[v].kind in ("alternating", "hybrid")]\n', encoding="utf-8")
    module.write_text('if build["kind"] != "mean" or card.kind in ("flow", "x"):\n    pass\n', encoding="utf-8")
    assert len(compared(rule)) == 1 and len(compared(module)) == 2
