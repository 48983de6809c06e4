"""The classical estimator: nonlinear least squares on each window with the expert alone."""

from __future__ import annotations

from typing import Unpack

from expertaug import systems
from expertaug.api import arrays
from expertaug.api.arrays import Ranges, RefinementOptions
from expertaug.api.trained import TrainedModel
from expertaug.config.presets import resolve
from expertaug.inference.settings import RefinementSettings
from expertaug.learning.train import expert_alone
from expertaug.systems import System
from expertaug.trajectories import Trajectories


def least_squares(
    system: System,
    train: Trajectories,
    *,
    observed_s: float,
    prior: Ranges,
    noise: float = 0.0,
    label: str = "Least squares",
    **options: Unpack[RefinementOptions],
) -> TrainedModel:
    """Nonlinear least squares on each observed window with the expert alone; nothing is trained.

    Arguments:
        system: gives F_e.
        train: whose times and largest values count (how far a forecast may go; the noise where data have none).
        observed_s: end of the observed window t1 in s, which is included.
        prior: ranges [low, high] by expert parameter, in its unit, in which the fits start.
        noise: standard deviation of the data's noise; the first point is estimated too where there is any.
        options: see :class:`expertaug.inference.settings.RefinementSettings`.

    Returns:
        a model that forecasts and is scored like a trained one.

    Raises:
        InputError: an argument that cannot be used.
    """
    described = {"system": systems.describe(system), "model": {}, "expert": True, "interaction": False}
    settings = {
        "experiment": described["system"]["name"],
        "method": "least_squares",
        "label": label,
        "preset": "corrected",
        "choices": resolve("corrected"),
        "training": {},
        "t1_s": float(observed_s),
        "seeds": [0],
        "refinement": {
            "settings": RefinementSettings.from_mapping(options).model_dump(mode="json"),
            "noise": float(noise),
            "prior": arrays.ranges(prior, [p.name for p in system.expert_parameters], "prior"),
        },
    }
    stored = expert_alone(system, train, settings, described)
    model = TrainedModel(stored, single=True, refinement=stored.description["refinement"])
    _ = model.predictor  # says what is wrong with the options
    return model
