"""The stage own-prior: ranges of p⁺ of a model, or of an experiment before anything is trained, as a file."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from expertaug import systems
from expertaug.files import write_text
from expertaug.inference import store
from expertaug.inference.own_prior import OwnPrior, box, own_prior_without_windows, searching
from expertaug.inference.own_prior import own_prior as grown
from expertaug.inference.settings import FirstPriorJob, OwnPriorJob
from expertaug.learning.train import constants_of, described_by, expert_alone
from expertaug.learning.training_data import StackedSet
from expertaug.models.store import device_of
from expertaug.trajectories import Trajectories

SAMPLES = 200  # windows of each set that are fitted, at most, evenly spread


def own_prior(
    model: Path | None, data: Path, output: Path, settings: OwnPriorJob, calibration: Path | None = None
) -> OwnPrior:
    """Stage: find the ranges of p⁺ and write them.

    Arguments:
        model: file of a trained model; None: the expert alone, before anything is trained.
        data: folder of the sets; of those that ``windows`` names only the observed part is used.
        output: JSON {ranges, training, explained, limit, rounds, windows, says}.
        settings: of the job; for the expert alone a :class:`FirstPriorJob`.
        calibration: JSON whose ``constants`` complete the system's settings.
    """
    train = Trajectories.load(Path(data) / "train.npz")
    if isinstance(settings, FirstPriorJob):
        described = described_by(settings, None if calibration is None else constants_of(calibration))
        system = systems.load(described.system)
        stored, first = expert_alone(system, train, settings.expert, described), box(system)
    else:
        assert model is not None, "a job of the expert alone says what it is"
        stored = store.load(model, device_of(settings.device), settings.classes or ())
        first = box(stored.model.system)  # beside the model's own estimates, which may be wrong
    noise, known = settings.noise, _trajectories(train)
    how = settings.refinement if model is not None else searching(settings.refinement)
    if settings.windows:
        observed = stored.card.observed
        sets = [_trajectories(Trajectories.load(Path(data) / f"{name}.npz")) for name in settings.windows]
        found = grown(stored, known[:observed], torch.cat([one[:observed] for one in sets], dim=1), noise, first, how)
    else:
        found = own_prior_without_windows(stored, known, noise, settings.budget, first, how)
    write_text(Path(output), json.dumps({**asdict(found), "says": found.says}, indent=2) + "\n")
    return found


def _trajectories(data: Trajectories) -> Tensor:
    """At most so many trajectories, (T, N, *observed)."""
    index = np.linspace(0, len(data) - 1, min(SAMPLES, len(data))).astype(int)
    return StackedSet.of(data.subset(index), torch.device("cpu")).windows(len(data.t))[:, 0]
