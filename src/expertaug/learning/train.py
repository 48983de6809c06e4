"""The stage train."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import torch

from expertaug import systems
from expertaug.files import read_json
from expertaug.learning.bound import bound_of
from expertaug.learning.fitting import fit
from expertaug.learning.sets import StackedSet
from expertaug.learning.task import task_of
from expertaug.models import store
from expertaug.models.device import device_of
from expertaug.models.mean import MeanModel
from expertaug.registry import find
from expertaug.trajectories import Trajectories, points_until


def train(
    data: Path, output: Path, work: Path, settings: Mapping, tracking: Mapping | None, calibration: Path | None = None
) -> None:
    """Stage: train a method on ``data/train.npz`` and select on ``data/validation.npz``.

    Arguments:
        data: folder of the sets.
        output: model file.
        work: folder for checkpoints.
        settings: {experiment, method, label, preset, system, build, model, training, t1_s, choices, seeds, device}.
        tracking: see :class:`expertaug.tracking.runlog.RunLog`.
        calibration: JSON whose ``constants`` complete the system's settings.

    Raises:
        InputError: unusable data or settings.
        SolveError: a seed cannot be trained.
    """
    build, choices = dict(settings["build"]), settings["choices"]
    system_settings = dict(settings["system"]) | build.get("system", {})
    if calibration is not None and system_settings.get("expert") != "point_mass":
        system_settings["constants"] = read_json(calibration)["constants"]
    system = systems.load(system_settings)
    train_data, validation_data = (Trajectories.load(Path(data) / f"{name}.npz") for name in ("train", "validation"))
    t = [float(v) for v in train_data.t]
    observed = points_until(t, settings["t1_s"]) - (choices["observed_points"] == "exclusive")
    objective = build.get("objective", "aphynity")
    description = {
        "kind": build["kind"],
        "system": system_settings,
        "model": settings["model"],
        "expert": build.get("expert", True),
        "interaction": build.get("interaction", True),
        "likelihood": find("objective", objective, "objective").learns_likelihood,
        "t": t,
        "observed": observed,
        "bound": bound_of(train_data.y),
        "training": settings["training"],
        **{k: settings[k] for k in ("experiment", "method", "label", "preset", "choices", "seeds")},
    }
    if build["kind"] == "mean":
        model = MeanModel(system, torch.from_numpy(train_data.y).mean(0))
        store.save(output, model, description | {"wall_s": 0.0, "best_score": None})
        return
    device = device_of(settings["device"])
    model = store.make(system, description)
    train_set, validation_set = StackedSet.of(train_data, device), StackedSet.of(validation_data, device)
    model.fit(train_set.y[:observed, 0])
    task = task_of(settings["training"], description, device)
    fit(
        model.to(device),
        lambda points: (train_set.window(points), [(validation_set, task.selection(choices))]),
        task,
        description | {"stage": "train", "objective": objective},
        settings,
        (output, work, [Path(data) / "train.npz", Path(data) / "validation.npz"]),
        tracking,
    )
