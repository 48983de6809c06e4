"""Subcommands that look at data before there is a configuration, or forecast with a trained model."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from pathlib import Path

from expertaug.errors import InputError
from expertaug.stages.options import add_paths, read_settings

logger = logging.getLogger(__name__)


def add_to(add: Callable[..., argparse.ArgumentParser]) -> None:
    """Add this module's subcommands."""
    examples = """
    expertaug inspect-video my/*.mp4 --output contact.png > my.yaml
    expertaug inspect-video my/series --times names --time-unit 0.001
    """
    text = "show what is in videos and propose a configuration"
    p = add("inspect-video", _inspect, text, "use", examples, ["inspect"])
    p.add_argument("videos", type=Path, nargs="+", metavar="VIDEO", help="video file, or folder of pictures")
    text = "contact sheet, .png or .jpg (default: %(default)s)"
    p.add_argument("--output", type=Path, default=Path("contact.png"), metavar="PATH", help=text)
    p.add_argument("--rate", type=float, metavar="HZ", help="frame rate (default: the videos' own)")
    for name, text in (("from", "first"), ("to", "last")):
        p.add_argument(f"--{name}", type=float, metavar="S", dest=f"{name}_s", help=f"{text} second that is used")
    text = "times of pictures: a CSV in their folder with the columns file and t, or names"
    p.add_argument("--times", metavar="CSV", help=text)
    p.add_argument("--time-unit", type=float, metavar="S", help="seconds of a unit of these times (default: 1)")

    text = "write a table of simulated swings to try the other commands on"
    add("example-table", _example_table, text, "use", "expertaug example-table > swings.csv")

    examples = """
    expertaug inspect-data swings.csv --system pendulum > mine.yaml
    expertaug inspect-data lab/*.csv --system pendulum --unit angle=deg --set skip_lines=3
    """
    p = add("inspect-data", _inspect_data, "show what tables hold and propose a configuration", "use", examples)
    p.add_argument("files", nargs="+", metavar="FILE", help="tables or globs: CSV, Parquet or NPZ")
    text = "system whose state the columns hold: a name, or JSON with name and arguments (default: none)"
    p.add_argument("--system", metavar="NAME", help=text)
    p.add_argument("--time", metavar="COLUMN", help="the column of times (default: by its name)")
    p.add_argument(
        "--trajectory", metavar="COLUMN", help="column that names each row's trajectory (default: by its name)"
    )
    text = "unit of a column, such as 'theta=deg' (default: as its header says); may be given several times"
    p.add_argument("--unit", metavar="COLUMN=UNIT", action="append", default=[], help=text)
    text = "set a key of data.files, such as 'time_format=%%d.%%m.%%Y' or skip_lines=3; may be given several times"
    p.add_argument("--set", metavar="KEY=VALUE", action="append", default=[], help=text)
    text = "picture of the data, .png or .pdf (default: %(default)s)"
    p.add_argument("--output", type=Path, default=Path("data.png"), metavar="PATH", help=text)

    examples = """
    expertaug forecast --model model.safetensors window.csv --output forecast.csv
    expertaug forecast --model model.safetensors window.csv --refine estimated
    """
    p = add("forecast", _forecast, "forecast from observed windows with a trained model", "use", examples)
    text = "CSV with t in s, the state's components and, for several windows, sample; or a table like the training's"
    p.add_argument("window", type=Path, help=text)
    add_paths(p, model="model file")
    p.add_argument("--output", type=Path, metavar="CSV", help="file of the forecasts (default: standard output)")
    text = "one of the model's seeds, or median: one forecast of all of them (default: each)"
    p.add_argument("--seed", type=_seed, metavar="SEED", help=text)
    p.add_argument("--t-end", type=float, metavar="S", help="end of the forecast in s (default: the training's)")
    text = "refine the estimates by least squares on each window: the noise's standard deviation, 0 for none, or "
    p.add_argument("--refine", type=_noise, metavar="NOISE", help=text + "estimated for that of the training data")
    text = "trajectories that set the threshold of the column trusted, such as a run's data/validation.npz "
    p.add_argument("--validation", type=Path, metavar="NPZ", help=f"{text}(default: the threshold in the model file)")
    text = "says how tables like the training's are read: data/splits.json of a run, or its configuration (default: "
    p.add_argument("--measurements", type=Path, metavar="FILE", help=text + "that of the run with the model file)")
    text = "package.module:Class of yours that the model needs; may be given several times"
    p.add_argument("--class", dest="classes", action="append", default=[], metavar="NAME", help=text)


def _inspect(a: argparse.Namespace) -> None:
    from expertaug_recordings.inspection.inspect import inspect
    from expertaug_recordings.settings import StatedTimes

    stated = {"rate_hz": a.rate, "times": a.times, "time_unit_s": a.time_unit}
    stated |= {"from_s": a.from_s, "to_s": a.to_s}
    stated_times = StatedTimes.from_mapping({k: v for k, v in stated.items() if v is not None})
    text = inspect(a.videos, a.output, stated_times)
    logger.info("%s: contact sheet", a.output)
    print(text, end="")


def _example_table(_: argparse.Namespace) -> None:
    from expertaug.measurements.example import table

    print(table(), end="")


def _inspect_data(a: argparse.Namespace) -> None:
    from expertaug.measurements.inspect import Inspection
    from expertaug.measurements.proposal import comment, proposal
    from expertaug.measurements.settings import MeasurementSettings

    settings = outline = None
    if a.system is not None:
        from expertaug import systems

        settings = read_settings(a.system) if a.system.lstrip().startswith("{") else {"name": a.system}
        outline = systems.outline(settings)
    units = dict(text.rpartition("=")[::2] for text in a.unit)
    overrides = dict(map(_key, a.set))
    MeasurementSettings.from_mapping({"paths": a.files, "columns": {"-": "-"}} | overrides, "--set")
    inspection = Inspection(a.files, outline and outline.names, a.time, a.trajectory, units, overrides)
    for line in inspection.lines():
        print(comment(line))
    inspection.draw(a.output)
    logger.info("%s: picture", a.output)
    priors, constants = (outline.priors, outline.constants) if outline else ({}, ())
    print(proposal(inspection, settings, priors, constants), end="")


def _noise(text: str) -> float | str:
    return text if text == "estimated" else float(text)


def _seed(text: str) -> int | str:
    return text if text == "median" else int(text)


def _key(text: str) -> tuple[str, object]:
    """A key and its value, from KEY=VALUE.

    Raises:
        InputError: the text is none.
    """
    import yaml

    name, equals, value = text.partition("=")
    if not equals:
        raise InputError("--set", f"found '{text}'", "give KEY=VALUE")
    if name == "time_format" or len(value) == 1:  # a pattern's %, and a separator, are no YAML
        return name, value
    try:
        return name, yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise InputError("--set", f"found '{text}'", "write the value as YAML") from error


def _forecast(a: argparse.Namespace) -> None:
    from expertaug.api.window_file import forecast_file

    forecast_file(a.model, a.window, a.output, a.seed, a.t_end, a.classes, a.refine, a.validation, a.measurements)
