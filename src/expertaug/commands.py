"""The subcommands of ``expertaug``: their arguments, and the stage that each one runs."""

from __future__ import annotations

import argparse
import json
import logging
from collections.abc import Callable, Mapping
from pathlib import Path

from expertaug import __version__
from expertaug.errors import InputError

logger = logging.getLogger(__name__)


class _Commands:
    """The subcommands' parsers, each with what all of them take."""

    def __init__(self, parser: argparse.ArgumentParser) -> None:
        self._subparsers = parser.add_subparsers(dest="stage", required=True, metavar="STAGE")

    def add(self, name: str, run: Callable, text: str, settings: bool = True) -> argparse.ArgumentParser:
        """A subcommand; ``settings`` says whether it takes any."""
        parser = self._subparsers.add_parser(name, help=text, description=f"{text[0].upper()}{text[1:]}.")
        parser.set_defaults(run=run)
        parser.add_argument("--log", type=Path, metavar="FILE", help="also write progress and errors to this file")
        if settings:
            parser.add_argument("--settings", required=True, metavar="JSON", help="JSON text, or a JSON or YAML file")
        return parser


def parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="expertaug", description="Run one stage of the pipeline.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = _Commands(parser)

    p = commands.add("init-tracking", _init_tracking, "create or upgrade the MLflow store")
    _files(p, output="JSON that logging stages read")

    p = commands.add("render-video", _render_video, "simulate a recording and render it as video")
    p.add_argument("--index", type=int, required=True, help="number of the recording, from 0")
    _files(p, output="video", truth="CSV of the true motion")

    p = commands.add("extract-frames", _extract_frames, "decode a video into a frame store")
    p.add_argument("video", type=Path)
    _files(p, output="frame store")
    _add_intake(p, checksum=True)

    p = commands.add("track-markers", _track_markers, "find the markers in every frame")
    p.add_argument("frames", type=Path)
    _files(p, output="CSV of the marker positions")
    _add_intake(p)

    p = commands.add("unpack-markers", _unpack_markers, "unpack an archive of marker CSVs")
    p.add_argument("archive", type=Path)
    _files(p, output="folder")

    p = commands.add("import-markers", _import_markers, "convert a marker CSV of the IBM layout")
    p.add_argument("csv", type=Path)
    _files(p, output="CSV of the marker positions")
    _add_intake(p, checksum=True)

    p = commands.add("measure-angles", _measure_angles, "measure arm angles, speeds and energy")
    p.add_argument("markers", type=Path)
    _files(p, output="CSV of the angles", summary="JSON of the recording's calibration")
    _add_intake(p)

    p = commands.add("summarise-recordings", _summarise_recordings, "make the table of recordings", settings=False)
    p.add_argument("summaries", type=Path, nargs="+", help="angles.json of each recording")
    _files(p, output="CSV", markdown="Markdown")

    p = commands.add("plot-recording", _plot_recording, "draw a recording's page of the report", settings=False)
    _files(p, markers="CSV of the marker positions", angles="CSV of the angles", summary="JSON of the calibration")
    _files(p, output="figure, .png or .pdf")

    p = commands.add("overlay", _overlay, "draw markers, arms, angles and forecasts over a recording's video")
    p.add_argument("video", type=Path)
    _files(p, markers="CSV of the marker positions", angles="CSV of the angles", output="video, .mp4")
    p.add_argument("--forecasts", nargs="*", default=[], metavar="LABEL=PATH", help="forecasts.npz to draw")
    p.add_argument("--chunks", type=Path, metavar="PATH", help="chunks.csv of the sets that they forecast")

    p = commands.add("inspect", _inspect, "show what a video shows and propose its configuration", settings=False)
    p.add_argument("video", type=Path)
    p.add_argument(
        "--output", type=Path, default=Path("contact.png"), metavar="PATH", help="contact sheet, .png or .jpg"
    )
    p.add_argument("--rate", type=float, metavar="HZ", help="frame rate (default: the video's own)")
    text = "YAML files to which the proposal is to be added (default: config/config.yaml where it is)"
    p.add_argument("--config", type=Path, nargs="+", metavar="YAML", help=text)

    p = commands.add("split-chunks", _split_chunks, "cut recordings into chunks and split them")
    p.add_argument("angles", type=Path, nargs="+", help="angles.csv of each recording")
    _files(p, output="folder of the sets")

    p = commands.add("plot-splits", _plot_splits, "draw the distributions of the splits", settings=False)
    p.add_argument("data", type=Path, help="folder of the sets")
    p.add_argument("--output", type=Path, nargs="+", required=True, help="figure files, .png or .pdf")

    p = commands.add("calibrate", _calibrate, "fit the expert's constants on training chunks")
    p.add_argument("train", type=Path, help="train.npz")
    _files(p, output="JSON of the constants")

    p = commands.add("simulate", _simulate, "simulate one set of a system")
    p.add_argument("set", help="name of the set")
    _files(p, output="npz of the trajectories")

    p = commands.add("train", _train, "train a method on a group of seeds")
    _files(p, data="folder of the sets", output="model file", work="folder for checkpoints")
    p.add_argument("--calibration", type=Path, help="JSON of the expert's constants")
    _add_tracking(p)

    p = commands.add("augment", _augment, "draw augmented samples from a trained model")
    _files(p, model="model file", data="folder of the sets", output="augmented samples")

    p = commands.add("finetune", _finetune, "fine-tune a model on real and augmented samples")
    _files(p, model="model file", augmented="augmented samples", data="folder of the sets")
    _files(p, output="model file", work="folder for checkpoints")
    _add_tracking(p)

    p = commands.add("evaluate", _evaluate, "score a model's forecasts on every set")
    _files(p, model="model file", data="folder of the sets", output="CSV of the metrics", forecasts="npz of forecasts")
    _add_tracking(p)

    p = commands.add("forecast", _forecast, "forecast from observed windows with a trained model", settings=False)
    p.add_argument("window", type=Path, help="CSV: t, the state's components; sample, where it holds several windows")
    _files(p, model="model file")
    p.add_argument("--output", type=Path, metavar="CSV", help="file of the forecasts (default: standard output)")
    p.add_argument("--seed", type=int, help="one of the model's seeds (default: all)")
    p.add_argument("--t-end", type=float, metavar="S", help="last time in s (default: the training's)")
    text = "package.module:Class of your own that the model may use; may be repeated"
    p.add_argument("--class", dest="classes", action="append", default=[], metavar="NAME", help=text)

    p = commands.add(
        "during-training", _during_training, "augment and fine-tune a model at several stages of its training"
    )
    _files(p, snapshots="states along the training", data="folder of the sets", output="CSV of the metrics")
    _files(p, work="folder for checkpoints")
    _add_tracking(p)

    p = commands.add("tabulate", _tabulate, "make the tables of an experiment")
    p.add_argument("metrics", type=Path, nargs="+", help="metrics.csv of every method and group of seeds")
    p.add_argument("--forecasts", type=Path, nargs="+", default=[], help="forecasts.npz, which know the units")
    p.add_argument("--output", type=Path, nargs="+", required=True, help="tables, .csv, .md or .tex")

    p = commands.add("plot", _plot, "draw the figures of an experiment")
    p.add_argument("metrics", type=Path, nargs="+", help="metrics.csv of every method and group of seeds")
    p.add_argument(
        "--forecasts", type=Path, nargs="+", required=True, help="forecasts.npz of one group of seeds per method"
    )
    p.add_argument(
        "--logs", type=Path, nargs="+", required=True, help="log.jsonl of every trained method and group of seeds"
    )
    _files(p, output="path of the figures, to which _NAME.png and _NAME.pdf are added")

    p = commands.add("study", _study, "make the table and the figure of a study")
    p.add_argument(
        "metrics", type=Path, nargs="+", help="metrics.csv (during_training.csv) of every variant and group of seeds"
    )
    p.add_argument("--output", type=Path, nargs="+", required=True, help="files, .csv, .md, .tex, .png or .pdf")

    p = commands.add("compare", _compare, "compare experiments with the published numbers")
    p.add_argument("metrics", type=Path, nargs="+", help="metrics.csv of every method and group of seeds")
    p.add_argument("--output", type=Path, nargs="+", required=True, help="tables, .csv, .md or .tex")

    p = commands.add("overview", _overview, "draw the figures over several experiments")
    p.add_argument("metrics", type=Path, nargs="+", help="metrics.csv of every experiment, method and group of seeds")
    _files(p, output="folder of the figures")

    p = commands.add("validate", _validate, "check configuration files", settings=False)
    p.add_argument("config", type=Path, nargs="+", help="YAML files, later ones win")

    p = commands.add("rebuild-tracking", _rebuild_tracking, "make the MLflow store again from the logs", settings=False)
    p.add_argument("results", type=Path, help="results folder")
    p.add_argument("--uri", help="of the store (default: sqlite in RESULTS/mlflow)")
    p.add_argument("--experiment", default="expertaug", help="name of the MLflow experiment")

    p = commands.add("publish", _publish, "keep the tables and figures of a finished run", settings=False)
    p.add_argument("config", type=Path, nargs="+", help="YAML files of the run, later ones win")
    p.add_argument("--to", type=Path, required=True, metavar="FOLDER", help="folder, which is replaced")
    p.add_argument("--command", required=True, help="how the run was started, for the record")
    return parser


def _files(parser: argparse.ArgumentParser, **options: str) -> None:
    for name, text in options.items():
        parser.add_argument(f"--{name}", type=Path, required=True, metavar="PATH", help=text)


def _add_intake(parser: argparse.ArgumentParser, checksum: bool = False) -> None:
    text = "a recording that is refused: stop, or skip it and write why into the outputs"
    parser.add_argument("--on-bad-recording", choices=("stop", "skip"), default="stop", help=text)
    if checksum:
        parser.add_argument("--sha256", metavar="HEX", help="checksum that the file must have")


def _add_tracking(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--tracking", type=Path, metavar="FILE", help="what init-tracking wrote; none: do not track")


def read_settings(text: str) -> dict:
    """A stage's settings: JSON text, or the path of a JSON or YAML file.

    Raises:
        InputError: neither, or no mapping.
    """
    import yaml

    try:
        if not text.lstrip().startswith("{"):
            text = Path(text).read_text(encoding="utf-8")
        value = yaml.safe_load(text) if not text.lstrip().startswith("{") else json.loads(text)
    except OSError as error:
        raise InputError("--settings", f"{text}: {error.strerror}", "give JSON text or the path of a file") from error
    except (ValueError, yaml.YAMLError) as error:
        raise InputError("--settings", f"neither JSON nor YAML ({error})", "give a JSON object") from error
    if not isinstance(value, dict):
        raise InputError("--settings", f"holds {type(value).__name__}", "give a JSON object")
    return value


def _tracking(a: argparse.Namespace) -> Mapping | None:
    """The tracking store that ``init-tracking`` prepared, for a stage that logs; None where it is switched off."""
    if a.tracking is None:
        return None
    from expertaug.files import read_json

    found = read_json(a.tracking)
    if not isinstance(found, dict) or "enabled" not in found:
        raise InputError(a.tracking, "does not say which tracking store", "make it again with init-tracking")
    return {**found, "tags": {"rule": a.stage}} if found["enabled"] else None


def _init_tracking(a: argparse.Namespace) -> None:
    from expertaug.files import read_json, write_json
    from expertaug.tracking.mlflow_store import initialise

    settings = read_settings(a.settings)
    if not settings["enabled"]:
        write_json(a.output, {"enabled": False})
        return
    initialise(settings["uri"], settings["experiment"], a.output)
    write_json(a.output, {"enabled": True, **read_json(a.output)})


def _render_video(a: argparse.Namespace) -> None:
    from expertaug.recordings.rendering.render import render_recording

    render_recording(a.index, a.output, a.truth, read_settings(a.settings))


def _take(a: argparse.Namespace, task: Callable[[], None], source: Path, outputs: list[Path]) -> None:
    """Run a stage on one recording, which may be left out."""
    from expertaug.recordings.intake import take

    take(task, source, outputs, a.on_bad_recording, getattr(a, "sha256", None))


def _extract_frames(a: argparse.Namespace) -> None:
    from expertaug.recordings.video.frame_store import extract_frames

    _take(a, lambda: extract_frames(a.video, a.output, read_settings(a.settings)), a.video, [a.output])


def _track_markers(a: argparse.Namespace) -> None:
    from expertaug.recordings.markers.track import track_markers

    _take(a, lambda: track_markers(a.frames, a.output, read_settings(a.settings)), a.frames, [a.output])


def _unpack_markers(a: argparse.Namespace) -> None:
    from expertaug.recordings.imports.ibm import unpack_archive

    unpack_archive(a.archive, a.output, read_settings(a.settings))


def _import_markers(a: argparse.Namespace) -> None:
    from expertaug.recordings.imports.ibm import import_markers

    _take(a, lambda: import_markers(a.csv, a.output, read_settings(a.settings)), a.csv, [a.output])


def _measure_angles(a: argparse.Namespace) -> None:
    from expertaug.recordings.angles.measure import measure_angles

    outputs = [a.output, a.summary]
    _take(a, lambda: measure_angles(a.markers, *outputs, read_settings(a.settings)), a.markers, outputs)


def _summarise_recordings(a: argparse.Namespace) -> None:
    from expertaug.recordings.intake import divide
    from expertaug.recordings.reports.summary import summarise

    kept, refused = divide(a.summaries)
    summarise(kept, a.output, a.markdown, refused)


def _plot_recording(a: argparse.Namespace) -> None:
    from expertaug.recordings.intake import refusal
    from expertaug.recordings.reports.page import plot_recording, plot_refused

    reason = refusal(a.summary)
    if reason is None:
        plot_recording(a.markers, a.angles, a.summary, a.output)
    else:
        plot_refused(a.summary.parent.name, reason, a.output)


def _overlay(a: argparse.Namespace) -> None:
    from expertaug.recordings.intake import refusal
    from expertaug.recordings.reports.overlay import note, overlay

    forecasts = dict(text.partition("=")[::2] for text in a.forecasts)
    for label, path in forecasts.items():
        if not (label and path):
            raise InputError("--forecasts", f"found '{label or path}'", "give LABEL=PATH")
    reason = refusal(a.angles)
    if reason is None:
        overlay(a.video, a.markers, a.angles, a.output, read_settings(a.settings), forecasts, a.chunks)
    else:
        note(f"left out: {reason}", a.output)


def _inspect(a: argparse.Namespace) -> None:
    from expertaug.config import load as config
    from expertaug.recordings.inspection.inspect import inspect

    default = Path("config", "config.yaml")
    files = a.config or ([default] if default.is_file() else [])
    base = config.validate(config.load(files)) if files else None
    text = inspect(a.video, a.output, base, a.rate)
    logger.info("%s: contact sheet", a.output)
    print(text, end="")


def _split_chunks(a: argparse.Namespace) -> None:
    from expertaug.recordings.chunks.cut import split_chunks
    from expertaug.recordings.intake import divide

    split_chunks(divide(a.angles)[0], a.output, read_settings(a.settings))


def _plot_splits(a: argparse.Namespace) -> None:
    from expertaug.recordings.reports.splits import plot_splits

    plot_splits(a.data, a.output)


def _calibrate(a: argparse.Namespace) -> None:
    from expertaug.recordings.angles.calibration import calibrate

    calibrate(a.train, a.output, read_settings(a.settings))


def _simulate(a: argparse.Namespace) -> None:
    from expertaug.systems.simulate import simulate

    simulate(a.set, a.output, read_settings(a.settings))


def _train(a: argparse.Namespace) -> None:
    from expertaug.learning.train import train

    train(a.data, a.output, a.work, read_settings(a.settings), _tracking(a), a.calibration)


def _augment(a: argparse.Namespace) -> None:
    from expertaug.learning.augment import augment

    augment(a.model, a.data, a.output, read_settings(a.settings))


def _finetune(a: argparse.Namespace) -> None:
    from expertaug.learning.finetune import finetune

    finetune(a.model, a.augmented, a.data, a.output, a.work, read_settings(a.settings), _tracking(a))


def _evaluate(a: argparse.Namespace) -> None:
    from expertaug.evaluation.evaluate import evaluate

    evaluate(a.model, a.data, a.output, a.forecasts, read_settings(a.settings), _tracking(a))


def _forecast(a: argparse.Namespace) -> None:
    from expertaug.api.window_file import forecast_file

    forecast_file(a.model, a.window, a.output, a.seed, a.t_end, a.classes)


def _during_training(a: argparse.Namespace) -> None:
    from expertaug.evaluation.during_training import during_training

    during_training(a.snapshots, a.data, a.output, a.work, read_settings(a.settings), _tracking(a))


def _tabulate(a: argparse.Namespace) -> None:
    from expertaug.evaluation.tables import tabulate

    tabulate(a.metrics, a.output, read_settings(a.settings), a.forecasts)


def _plot(a: argparse.Namespace) -> None:
    from expertaug.evaluation.plot import plot

    plot(a.metrics, a.forecasts, a.logs, a.output, read_settings(a.settings))


def _study(a: argparse.Namespace) -> None:
    from expertaug.evaluation.studies import study

    study(a.metrics, a.output, read_settings(a.settings))


def _compare(a: argparse.Namespace) -> None:
    from expertaug.evaluation.published import compare

    compare(a.metrics, a.output, read_settings(a.settings))


def _overview(a: argparse.Namespace) -> None:
    from expertaug.evaluation.overview import overview

    overview(a.metrics, a.output, read_settings(a.settings))


def _validate(a: argparse.Namespace) -> None:
    from expertaug.config import load as config

    config.validate(config.load(a.config))
    logger.info("%s: valid", ", ".join(map(str, a.config)))


def _rebuild_tracking(a: argparse.Namespace) -> None:
    from expertaug.tracking.rebuild import rebuild

    uri = a.uri or f"sqlite:///{a.results}/mlflow/mlflow.db"
    count = rebuild(a.results, uri, a.experiment)
    logger.info("%s: %d logs stored", uri, count)


def _publish(a: argparse.Namespace) -> None:
    from expertaug.evaluation.publish import publish

    publish(a.config, a.to, a.command)
    logger.info("%s: published", a.to)
