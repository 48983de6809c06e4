"""Running a trainer as a job: resumed after a kill, logged, its best state written as a model file."""

from __future__ import annotations

import inspect
import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path

import torch

from expertaug.learning import snapshots
from expertaug.learning.checkpoint import Checkpoint, fingerprint, locked
from expertaug.learning.settings import TrainSettings
from expertaug.learning.task import Task
from expertaug.learning.trainer import Trainer
from expertaug.models import store
from expertaug.models.hybrid import HybridNet
from expertaug.registry import find, modules
from expertaug.tracking.run import Run
from expertaug.tracking.runlog import RunLog


def fit(
    model: HybridNet,
    sets: Callable,
    task: Task,
    description: dict,
    settings: Mapping,
    paths: tuple[Path, Path, list[Path]],
    tracking: Mapping | None,
    unchanged: Mapping | None = None,
) -> None:
    """Train ``model``, resuming a killed run, and write its best state to the output.

    Seeds that cannot be trained are in the written description's ``failed``; their state is their best or first one.
    Where ``settings`` have ``snapshots``, a list of passes, the states after these are written beside it.
    """
    output, work, inputs = Path(paths[0]), Path(paths[1]), paths[2]
    choices, seeds = settings["choices"], list(settings["seeds"])
    train_set, validation = sets(task.points(choices))
    options = dict(settings["training"].get("objective", {}))
    kind = find("objective", description["objective"], "objective")
    given = {"prior": settings["prior"]} if "prior" in inspect.signature(kind).parameters else {}
    objective = kind(seeds, choices, **given, **options)
    name = f"{description['experiment']}/{description['label']} seeds {','.join(map(str, seeds))}"
    options, keep = TrainSettings.from_mapping(settings["training"]), settings.get("snapshots", ())
    failed = dict.fromkeys(description.get("failed", ()), "it failed in the training before")
    trainer = Trainer(model, objective, task, train_set, validation, seeds, options, name, keep, failed)
    with locked(work):
        wanted = {k: v for k, v in settings.items() if k != "device"}
        named = modules(description["system"]["name"], description["model"], description["objective"])
        code = [f"expertaug.learning.{description['stage']}", *named]
        checkpoint = Checkpoint(work, fingerprint(wanted, inputs, code))
        state = checkpoint.load()
        if state is not None:
            trainer.restore(state)
        run = Run(
            **{k: description[k] for k in ("experiment", "method", "label", "preset", "stage")},
            system=description["system"]["name"],
            seeds=seeds,
            params={k: v for k, v in settings.items() if k not in ("seeds", "label")},
            tags={"fingerprint": checkpoint.fingerprint},
        )
        resume = state["log"] if state is not None else None
        with RunLog(output.with_name("log.jsonl"), run, tracking, resume) as log:
            if state is None:
                for path in inputs:
                    log.dataset(path.stem, path)
            trainer.run(log, checkpoint)
            model.load_state_dict(trainer.best)
            for key, value in (unchanged or {}).items():
                if not torch.equal(model.state_dict()[key], value):
                    raise RuntimeError(f"{name}: fine-tuning changed {key}, which is frozen")
            record = {
                "wall_s": trainer.seconds,
                "best_score": [s if math.isfinite(s) else None for s in trainer.best_score.tolist()],
                "best_epoch": trainer.best_epoch.tolist(),
                "carried": objective.carried(),
                "failed": sorted(trainer.failed),
            }
            if keep:
                described = description | {"failed": record["failed"]}
                snapshots.save(output.with_name(snapshots.NAME), trainer.snapshots, described)
            store.save(output, model, json.loads(json.dumps(description | record)))
            log.artifact(output)
        checkpoint.remove()
