"""Trials of hyperparameters on validation data: ``python benchmarks/search.py pendulum aphynity --trial '{…}' …``.

A trial is a JSON mapping that overrides an experiment's blocks (model, training, alternation, augmentation, finetuning,
choices) for one method.  It is trained, with ``--augmented`` also fine-tuned, and scored on the training and the
validation set; the test set is never read.  Each trial adds a line to a CSV (search/<experiment>_<method>.csv in the
results folder of the configuration unless ``--table`` says otherwise) with the configuration files and the git revision
whose settings it overrides; a trial that stands there already is not repeated.  With ``--from-best N`` the N best of
the table are printed instead.
"""

from __future__ import annotations

import argparse
import csv
import hashlib
import json
import sys
from pathlib import Path

import numpy as np
import torch

from expertaug.config import jobs, stage_settings
from expertaug.config import load as config
from expertaug.config.models import Configuration
from expertaug.errors import InputError, SolveError
from expertaug.evaluation.metrics import log_mse, log_mse_of, parameter_errors
from expertaug.inference import alternating
from expertaug.inference.least_squares import refine_by
from expertaug.inference.settings import AlternateJob
from expertaug.learning import augment, finetune, train
from expertaug.learning.settings import AugmentJob, FinetuneJob, train_job
from expertaug.models import store
from expertaug.systems.settings import SimulateJob
from expertaug.systems.simulate import simulate
from expertaug.systems.solvers.solver import Solver
from expertaug.tracking.provenance import revision
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

COLUMNS = [
    "variant", "trial", "seeds", "minutes", "selection", "train", "validation", "validation_std", "parameter_error",
    "configuration", "revision"
]  # fmt: skip


@torch.no_grad()
def score(model: Path, data: Path, evaluation: dict) -> dict[str, np.ndarray]:
    """log-MSE of every seed on training and validation set, and the validation set's parameter error in %."""
    stored = store.load(model)
    card = stored.card
    estimator = refine_by(stored, card.refinement) if card.kind == "alternating" else stored.model
    solver, start = Solver.from_mapping(evaluation["solver"]), evaluation["from_s"]
    scores, metric = {}, log_mse_of(evaluation["convention"]).name
    for name in ("train", "validation"):
        truth = Trajectories.load(data / f"{name}.npz")
        truth = truth.subset(np.linspace(0, len(truth) - 1, min(len(truth), 500)).astype(int))
        whole, observed = Windows.of(truth), card.observed
        prediction, z_e = estimator.predict(whole.observed(observed).expand(len(stored.seeds)), solver)
        begin = observed if start is None else int(np.searchsorted(truth.t, start - 1e-9))
        scores[name] = log_mse(stored.model.system, prediction[begin:], whole.y[begin:])[metric].numpy()
    if z_e is not None:
        errors = parameter_errors(stored.model.system, z_e, torch.from_numpy(truth.z_e).unsqueeze(0))
        scores["parameter_error"] = errors["relative_error"].numpy()
    return scores


def run(settings: Configuration, experiment: str, method: str, augmented: bool, folder: Path) -> Path:
    """Train (and fine-tune) a trial unless its files are there; the model's file."""
    one, group = settings.experiments[experiment], next(iter(jobs.seed_groups(settings)))
    data = Path(settings.results, experiment, "data")
    if one.data.source == "simulation":
        for name in ("train", "validation"):
            if not (data / f"{name}.npz").exists():
                data.mkdir(parents=True, exist_ok=True)
                simulate(
                    name,
                    data / f"{name}.npz",
                    SimulateJob.from_mapping(stage_settings.simulate(settings, experiment, name)),
                )
    calibration = data / "calibration.json" if one.data.calibrate else None
    base = stage_settings.train(settings, experiment, method, group)
    model = folder / _digest(base) / "model.safetensors"
    model.parent.mkdir(parents=True, exist_ok=True)
    if not model.exists():
        if base["build"]["kind"] == "alternating":
            job = AlternateJob.from_mapping(base)
            alternating.run_stage(data, model, model.parent / "work", job, None, calibration)
        else:
            train.run_stage(data, model, model.parent / "work", train_job(base), None, calibration)
    if not augmented:
        return model
    drawn, tuned = (getattr(stage_settings, f)(settings, experiment, method, group) for f in ("augment", "finetune"))
    plus = model.parent / _digest([drawn, tuned]) / "model.safetensors"
    plus.parent.mkdir(parents=True, exist_ok=True)
    if not plus.exists():
        augment.run_stage(model, data, plus.with_name("augmented.safetensors"), AugmentJob.from_mapping(drawn))
        job = FinetuneJob.from_mapping(tuned)
        finetune.run_stage(model, plus.with_name("augmented.safetensors"), data, plus, plus.parent / "work", job, None)
    return plus


def _digest(settings: object) -> str:
    return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:12]


def row(model: Path, data: Path, evaluation: dict) -> dict:
    """What a trial's line of the table says of its model."""
    scores = score(model, data, evaluation)
    card = store.load(model).card
    return {
        "seeds": len(card.seeds),
        "minutes": round(card.wall_s / 60, 2),
        "selection": round(float(np.mean(card.best_score)), 3),
        "train": round(float(scores["train"].mean()), 3),
        "validation": round(float(scores["validation"].mean()), 3),
        "validation_std": round(float(scores["validation"].std(ddof=1)), 3) if len(scores["validation"]) > 1 else "",
        "parameter_error": round(float(scores["parameter_error"].mean()), 2) if "parameter_error" in scores else "",
    }


def main() -> None:
    """Run the trials one after the other."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("experiment")
    parser.add_argument("method")
    parser.add_argument("--trial", action="append", default=[], help="JSON overrides; may be given often")
    parser.add_argument("--augmented", action="store_true", help="fine-tune as well, and score the result")
    parser.add_argument("--configfile", nargs="*", default=["config/config.yaml"])
    parser.add_argument("--table", type=Path)
    parser.add_argument("--from-best", type=int)
    options = parser.parse_args()
    loaded = config.load(options.configfile)
    folder = Path(config.validate(loaded).results, "search")
    table = options.table or folder / f"{options.experiment}_{options.method}.csv"
    known = list(csv.DictReader(table.open(encoding="utf-8"))) if table.exists() else []
    if options.from_best:
        for line in sorted(known, key=lambda r: float(r["validation"]))[: options.from_best]:
            print(", ".join(f"{k} {v}" for k, v in line.items()))
        return
    variant = options.method + "+" * options.augmented
    for text in options.trial or ["{}"]:
        trial = json.dumps(json.loads(text), sort_keys=True)
        origin = {"configuration": " ".join(options.configfile), "revision": revision() or ""}
        line = {"variant": variant, "trial": trial} | origin
        if any(all(r[k] == line[k] for k in line) for r in known):
            continue
        over = json.loads(trial)
        override = {"choices": over.pop("choices", {}), "overrides": {options.method: over}}
        settings = config.validate(config.merge(loaded, {"experiments": {options.experiment: override}}))
        try:
            model = run(settings, options.experiment, options.method, options.augmented, folder / options.experiment)
        except SolveError as error:
            print(f"{variant} {trial}: {error}", file=sys.stderr)
            continue
        data = Path(settings.results, options.experiment, "data")
        line |= row(model, data, settings.experiments[options.experiment].evaluation.dump())
        print(line, flush=True)
        table.parent.mkdir(parents=True, exist_ok=True)
        new = not table.exists()
        with table.open("a", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, COLUMNS)
            if new:
                writer.writeheader()
            writer.writerow(line)


if __name__ == "__main__":
    try:
        main()
    except InputError as problem:
        print(problem, file=sys.stderr)
        sys.exit(2)
