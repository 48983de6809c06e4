"""Figures of models in memory; each function returns a matplotlib Figure, which a notebook shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
from expertaug.evaluation.forecasts import Forecasts, KeptForecasts, SetForecasts
from expertaug.evaluation.settings import FigureReading, ParameterReading
from expertaug.trajectories import Trajectories

__all__ = ["alarm", "calibration", "course", "forecasts", "parameters"]

SET = "data"  # the name of the set that is given
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
    forecasts_by_label = {label: _forecasts(model, shown) for label, model in _label(models).items()}
    reading = FigureReading(labels=[(label, label) for label in forecasts_by_label], set_titles={SET: "given"})
    view = traces.View(set=SET, samples=range(len(chosen)), seed=seed)
    with plotting.use_style():
        return traces.forecasts(
            forecasts_by_label, reading, view, {label: f"model {label}" for label in forecasts_by_label}
        )


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
    forecasts_by_label = {}
    for label, model in _label(models).items():
        estimates = {
            name: model.estimate(part.seen[:, : model.observed], part.t, u=part.u) for name, part in named.items()
        }
        if any(estimates.values()):
            forecasts_by_label[label] = _of_sets(
                model,
                next(iter(named.values())).t,
                {
                    name: SetForecasts(
                        z_e=named[name].z_e,
                        z_e_hat=np.stack([np.atleast_2d(v) for v in each.values()], axis=-1)
                        if name != "train" or len(named) == 1
                        else None,
                    )
                    for name, each in estimates.items()
                },
            )
    if not forecasts_by_label:
        raise InputError("models", "none estimates parameters", "give a hybrid model")
    ranges = ParameterReading.of(
        labels=[(label, label) for label in forecasts_by_label], priors=dict.fromkeys(forecasts_by_label, prior or {})
    )
    with plotting.use_style():
        return parameter_figures.parameters(forecasts_by_label, ranges)


def course(model: TrainedModel, metrics: Sequence[str] = ("loss", "validation_score")) -> Figure:
    """The course of a training, a line per seed.

    Arguments:
        model: of :func:`expertaug.fit` or :func:`expertaug.finetune`; a file does not keep the course.
        metrics: of ``model.history``; ``validation_score`` is the selection score.

    Raises:
        InputError: the model has no such metric.
    """
    logged = list(dict.fromkeys(model.history["metric"]))
    if missing := [name for name in metrics if name not in logged]:
        raise InputError(
            "metrics", f"no {missing[0]}", f"known: {', '.join(logged) or 'none, the model is from a file'}"
        )
    with plotting.use_style():
        figure = plotting.new_figure(2.4)
        axes = figure.subplots(1, len(metrics), squeeze=False)[0]
        for axis, name in zip(axes, metrics, strict=True):
            for seed, part in model.history[model.history["metric"] == name].groupby("seed"):
                axis.plot(part["step"], part["value"], label=f"seed {seed}")
            axis.set(xlabel="step", ylabel=traces.METRICS.get(name, name.replace("_", " ")))
        plotting.legend(figure, axes[0].get_lines())
    return figure


def _label(models: Models) -> dict[str, TrainedModel]:
    return {models.label: models} if isinstance(models, TrainedModel) else dict(models)


def _of_sets(model: TrainedModel, t: np.ndarray, sets: dict[str, SetForecasts]) -> Forecasts:
    system = model.system
    return Forecasts(
        t=t,
        observed=model.observed - 1,
        seeds=model.seeds,
        state_names=[p.name for p in system.state],
        state_units=[p.unit for p in system.state],
        parameter_names=[p.name for p in system.expert_parameters],
        parameter_units=[p.unit for p in system.expert_parameters],
        sets=sets,
    )


def _forecasts(model: TrainedModel, data: Trajectories) -> Forecasts:
    arguments.trajectories(data, "data")
    y = np.asarray(model.forecast(data.seen[:, : model.observed], data.t, u=data.u).y)
    kept = KeptForecasts(index=np.arange(len(data)), truth=data.seen, prediction=y[None] if model.single else y)
    return _of_sets(model, data.t, {SET: SetForecasts(z_e=data.z_e, kept=kept)})
