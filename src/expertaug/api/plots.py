"""Figures of models in memory; each function returns a matplotlib Figure, which a notebook shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.api import arguments
from expertaug.api.arguments import Ranges
from expertaug.api.trained import TrainedModel
from expertaug.errors import InputError
from expertaug.evaluation import parameters as parameter_figures
from expertaug.evaluation import traces
from expertaug.evaluation.diagnostic_figures import draw_alarm as alarm
from expertaug.evaluation.diagnostic_figures import draw_calibration as calibration
from expertaug.evaluation.forecast_file import Forecasts
from expertaug.trajectories import Trajectories

__all__ = ["alarm", "calibration", "course", "forecasts", "parameters"]

Models = TrainedModel | Mapping[str, TrainedModel]


def forecasts(
    models: Models, data: Trajectories, *, samples: Sequence[int] = (0, 1, 2), seed: int | None = None
) -> Figure:
    """Forecasts against the truth: a row per component of the state, a column per sample.

    Arguments:
        models: one, or several by label.
        data: with the times of the training; any may follow the observed window.
        samples: places in ``data``.
        seed: whose forecasts are drawn; default: the models' first.

    Raises:
        InputError: the set lacks a sample, or a model the seed.
    """
    chosen = [k for k in samples if -len(data) <= k < len(data)]
    if not chosen or (len(chosen) < len(samples) and tuple(samples) != (0, 1, 2)):
        raise InputError("samples", f"found {list(samples)}", f"the set has {len(data)}")
    shown = data.subset(np.array(chosen))
    found = {label: _forecasts(model, shown) for label, model in _labelled(models).items()}
    settings = {"labels": [(label, label) for label in found], "set": "data", "samples": list(range(len(chosen)))}
    settings |= {"set_titles": {"data": "given"}} | ({} if seed is None else {"seed": seed})
    with plotting.styled():
        return traces.draw_forecasts(found, settings, {label: f"model {label}" for label in found})


def parameters(
    models: Models, sets: Trajectories | Mapping[str, Trajectories], *, prior: Ranges | None = None
) -> Figure:
    """Estimated against true expert parameters: a row per parameter, a column per model.

    Arguments:
        models: one, or several by label.
        sets: with true z_e; several by name: one named train is only shaded.
        prior: ranges of p⁺ by parameter, drawn as dashed lines.

    Raises:
        InputError: no model estimates parameters.
    """
    named = {"test": sets} if isinstance(sets, Trajectories) else dict(sets)
    found = {}
    for label, model in _labelled(models).items():
        estimates = {
            name: model.estimate(part.seen[:, : model.observed], part.t, u=part.u) for name, part in named.items()
        }
        if any(estimates.values()):
            found[label] = _empty(model, next(iter(named.values())).t) | {
                "truths": {name: part.z_e for name, part in named.items()},
                "estimates": {
                    name: np.stack([np.atleast_2d(v) for v in each.values()], axis=-1)
                    for name, each in estimates.items()
                    if name != "train" or len(named) == 1
                },
            }
    if not found:
        raise InputError("models", "none estimates parameters", "give a hybrid model")
    settings = {"labels": [(label, label) for label in found], "priors": {label: dict(prior or {}) for label in found}}
    with plotting.styled():
        return parameter_figures.draw_parameters({label: Forecasts(**each) for label, each in found.items()}, settings)


def course(model: TrainedModel, metrics: Sequence[str] = ("loss", "validation_score")) -> Figure:
    """The course of a training, a line per seed.

    Arguments:
        model: of :func:`expertaug.fit` or :func:`expertaug.finetune`; a file does not keep the course.
        metrics: of ``model.history``; ``validation_score`` is the log mean squared error that selects.

    Raises:
        InputError: the model has no such metric.
    """
    known = list(dict.fromkeys(model.history["metric"]))
    if missing := [name for name in metrics if name not in known]:
        raise InputError(
            "metrics", f"no {missing[0]}", f"known: {', '.join(known) or 'none, the model is from a file'}"
        )
    with plotting.styled():
        figure = plotting.new_figure(2.4)
        axes = figure.subplots(1, len(metrics), squeeze=False)[0]
        for axis, name in zip(axes, metrics, strict=True):
            for seed, part in model.history[model.history["metric"] == name].groupby("seed"):
                axis.plot(part["step"], part["value"], label=f"seed {seed}")
            axis.set(xlabel="step", ylabel=name.replace("_", " "))
        plotting.legend(figure, axes[0].get_lines())
    return figure


def _labelled(models: Models) -> dict[str, TrainedModel]:
    return {models.label: models} if isinstance(models, TrainedModel) else dict(models)


def _empty(model: TrainedModel, t: np.ndarray) -> dict[str, Any]:
    """Fields of :class:`Forecasts` without any sample."""
    system = model.system
    return {
        "t": t,
        "observed": model.observed - 1,
        "seeds": model.seeds,
        "state_names": [p.name for p in system.state],
        "state_units": [p.unit for p in system.state],
        "parameter_names": [p.name for p in system.expert_parameters],
        "parameter_units": [p.unit for p in system.expert_parameters],
        **{name: {} for name in ("index", "truth", "prediction", "truths", "estimates")},
    }


def _forecasts(model: TrainedModel, data: Trajectories) -> Forecasts:
    arguments.trajectories(data, "data")
    y = np.asarray(model.forecast(data.seen[:, : model.observed], data.t, u=data.u).y)
    filled = {"index": np.arange(len(data)), "truth": data.seen, "prediction": y[None] if model.single else y}
    sets: dict[str, Any] = {k: {"data": v} for k, v in (filled | {"truths": data.z_e}).items()}
    return Forecasts(**_empty(model, data.t) | sets)
