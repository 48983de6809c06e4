"""The stage overview: figures over all experiments of a run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from expertaug import plotting
from expertaug.evaluation.dots import Panel, draw_dots
from expertaug.evaluation.summary import CONVENTIONS, experiment_title, in_domain, log_mse_name, read_metrics
from expertaug.labels import paired


def overview(metrics: Sequence[Path], output: Path, settings: Mapping) -> None:
    """Draw log_mse (paper's figure log_mse), parameter_errors (param_acc) and, where an experiment asks for it,
    za_shifted, each as .png and .pdf: a panel for each experiment, methods with their augmented versions and opponents.

    Arguments:
        metrics: metrics.csv of every experiment, method and group of seeds.
        output: folder of the figures.
        settings: {experiments, all_methods}: of each experiment its name, whether the first two figures show it
            (``shown``), the set that za_shifted shows (``shifted``, or null), ``opponents`` that are never augmented,
            and how its numbers are read (convention, set_titles, title, from_s); all methods of the configuration,
            which fix the colours.

    Raises:
        InputError: a file is broken.
    """
    table = read_metrics(metrics)
    shared = {"all_methods": settings["all_methods"]}
    folder = Path(output)
    shown = [one for one in settings["experiments"] if one["shown"]]
    if shown:
        panels = []
        for one in shown:
            how = CONVENTIONS[one["convention"]].partition(" over")[0]
            part = _shown(table, one, log_mse_name(one["convention"]))
            panels.append(Panel(f"{_title(one)} ({how})", part, one))
        note = "log-MSE, squared error summed or averaged over the observed dimensions"
        draw_dots(panels, folder / "log_mse", shared, "log-MSE", note)
        panels = [Panel(_title(one), _shown(table, one, "relative_error"), one) for one in shown]
        panels = [panel for panel in panels if len(panel.table)]
        if panels:
            note = "mean relative error of the expert parameters"
            draw_dots(panels, folder / "parameter_errors", shared, "relative error [%]", note, logarithmic=True)
        else:
            plotting.save_note("no method estimates parameters", folder / "parameter_errors")
    panels = [
        Panel(_title(one), _shown(table, one, log_mse_name(one["convention"]), [one["shifted"]]), one)
        for one in settings["experiments"]
        if one["shifted"]
    ]
    if panels:
        note = "log-MSE where the interaction's parameters are shifted as well"
        draw_dots(panels, folder / "za_shifted", shared, "log-MSE", note)


def _shown(table: pd.DataFrame, one: Mapping, metric: str, sets: Sequence[str] = ()) -> pd.DataFrame:
    """Rows of the methods that have an augmented version, and of these versions, or of all where there is none; and of
    the opponents that never have one.

    Arguments:
        sets: by default the set of the training's domain and the test set.
    """
    part = table[(table["experiment"] == one["name"]) & (table["metric"] == metric)]
    part = part[part["set"].isin(sets or (in_domain(part["set"]), "test"))]
    return part[part["method"].isin([*paired(part["method"]), *one["opponents"]])]


def _title(one: Mapping) -> str:
    return experiment_title(one["name"], one)
