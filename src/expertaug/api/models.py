"""Trained models from files, and their forecasts and scores as functions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path

import pandas as pd

from expertaug.api import arrays
from expertaug.api.arrays import Array
from expertaug.api.forecasts import Forecast
from expertaug.api.trained import TrainedModel
from expertaug.inference.store import load as load_any
from expertaug.models.store import device_of
from expertaug.trajectories import Trajectories


def load(path: str | Path, *, classes: Collection[str | Callable] = (), device: str = "cpu") -> TrainedModel:
    """Read a model file, of this package's functions or of a workflow's run.

    Arguments:
        classes: where the model is made of classes of your own: these, or their names ``package.module:Class``.  A file
            that names others is refused: nothing is imported that you do not name.
        device: auto, cpu or cuda.

    Raises:
        InputError: the file is missing, damaged or no model file, or needs a class that ``classes`` does not name.
    """
    with arrays.one_thread():
        stored = load_any(path, device_of(device), classes)
    return TrainedModel(stored, refinement=stored.card.refinement)


def forecast(model: TrainedModel, window: Array, t: Array | Sequence[float], **options: object) -> Forecast:
    """:meth:`TrainedModel.forecast`."""
    return model.forecast(window, t, **options)  # type: ignore[arg-type]


def evaluate(model: TrainedModel | Mapping[str, TrainedModel], data: Trajectories, **options: object) -> pd.DataFrame:
    """:meth:`TrainedModel.evaluate`, of one model or of several by label (a column ``label`` is then added)."""
    if isinstance(model, TrainedModel):
        return model.evaluate(data, **options)  # type: ignore[arg-type]
    each = {label: one.evaluate(data, **options) for label, one in model.items()}  # type: ignore[arg-type]
    return pd.concat(each, names=["label"]).reset_index(level="label").reset_index(drop=True)
