"""Subcommands from a video or a file of markers to chunks of angles."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from expertaug.commands.options import Commands, add_outputs, add_paths, read_settings
from expertaug.errors import InputError

if TYPE_CHECKING:
    from expertaug.settings import Settings

J = TypeVar("J", bound="Settings")
logger = logging.getLogger(__name__)


def add_to(commands: Commands) -> None:
    """Add this module's subcommands."""
    p = commands.add("render-video", _render_video, "simulate a recording and render it as video")
    p.add_argument("--index", type=int, required=True, help="number of the recording, from 0")
    add_paths(p, output="video", truth="CSV of the true motion")

    p = commands.add("extract-frames", _extract_frames, "decode a video into a frame store")
    p.add_argument("video", type=Path)
    add_paths(p, output="frame store")
    _add_intake(p, checksum=True)

    p = commands.add("track-markers", _track_markers, "find the markers in every frame")
    p.add_argument("frames", type=Path)
    add_paths(p, output="CSV of the marker positions")
    _add_intake(p)

    p = commands.add("unpack-markers", _unpack_markers, "unpack an archive of marker CSVs")
    p.add_argument("archive", type=Path)
    add_paths(p, output="folder")

    p = commands.add("import-markers", _import_markers, "convert a marker CSV of the IBM layout")
    p.add_argument("csv", type=Path)
    add_paths(p, output="CSV of the marker positions")
    _add_intake(p, checksum=True)

    p = commands.add("measure-angles", _measure_angles, "measure arm angles, speeds and energy")
    p.add_argument("markers", type=Path)
    add_paths(p, output="CSV of the angles", summary="JSON of the recording's calibration")
    _add_intake(p)

    p = commands.add("summarise-recordings", _summarise_recordings, "make the table of recordings", settings=False)
    p.add_argument("summaries", type=Path, nargs="+", help="angles.json of each recording")
    add_paths(p, output="CSV", markdown="Markdown")

    p = commands.add("plot-recording", _plot_recording, "draw a recording's page of the report", settings=False)
    add_paths(p, markers="CSV of the marker positions", angles="CSV of the angles", summary="JSON of the calibration")
    add_paths(p, output="figure, .png or .pdf")

    p = commands.add("overlay", _overlay, "draw markers, arms, angles and forecasts over a recording's video")
    p.add_argument("video", type=Path)
    add_paths(p, markers="CSV of the marker positions", angles="CSV of the angles", summary="JSON of the calibration")
    add_paths(p, output="video, .mp4")
    p.add_argument("--forecasts", nargs="*", default=[], metavar="LABEL=PATH", help="forecasts.npz to draw")

    p = commands.add("review-recording", _review_recording, "draw a recording's worst frames")
    p.add_argument("video", type=Path)
    add_paths(p, markers="CSV of the marker positions", angles="CSV of the angles", summary="JSON of the calibration")
    add_paths(p, output="sheet, .jpg or .png", rows="CSV of these frames, to be corrected")

    p = commands.add("review", _review, "make the page of all recordings' worst frames", settings=False)
    p.add_argument("summaries", type=Path, nargs="+", help="angles.json of each recording, with its review beside it")
    add_paths(p, output="page, .html")

    p = commands.add(
        "export-recording", _export_recording, "write a recording in formats of other programs", settings=False
    )
    add_paths(p, markers="CSV of the marker positions", angles="CSV of the angles", output="folder")

    p = commands.add("inspect", _inspect, "show what videos show and propose their configuration", settings=False)
    p.add_argument("videos", type=Path, nargs="+", metavar="VIDEO", help="video file, or folder of pictures")
    text = "contact sheet, .png or .jpg"
    p.add_argument("--output", type=Path, default=Path("contact.png"), metavar="PATH", help=text)
    p.add_argument("--rate", type=float, metavar="HZ", help="frame rate (default: the videos' own)")
    for name, text in (("from", "first"), ("to", "last")):
        p.add_argument(f"--{name}", type=float, metavar="S", dest=f"{name}_s", help=f"{text} second that is used")
    text = "times of pictures: a CSV in their folder with the columns file and t, or names"
    p.add_argument("--times", metavar="CSV", help=text)
    p.add_argument("--time-unit", type=float, metavar="S", help="seconds of a unit of these times (default: 1)")

    p = commands.add("split-chunks", _split_chunks, "cut recordings into chunks and split them")
    p.add_argument("angles", type=Path, nargs="+", help="angles.csv of each recording")
    add_paths(p, output="folder of the sets")

    p = commands.add("cut-horizon", _cut_horizon, "cut long chunks out of the frames of a split")
    p.add_argument("angles", type=Path, nargs="+", help="angles.csv of each recording")
    add_paths(p, output="npz of the set")

    p = commands.add("plot-splits", _plot_splits, "draw the distributions of the splits", settings=False)
    p.add_argument("data", type=Path, help="folder of the sets")
    add_outputs(p, "figure files, .png or .pdf")


def _add_intake(parser: argparse.ArgumentParser, checksum: bool = False) -> None:
    text = "a recording that is refused: stop, or skip it and write why into the outputs"
    parser.add_argument("--on-bad-recording", choices=("stop", "skip"), default="stop", help=text)
    if checksum:
        parser.add_argument("--sha256", metavar="HEX", help="checksum that the file must have")


def _job(a: argparse.Namespace, kind: type[J]) -> J:
    """The stage's settings, read before anything is done."""
    return kind.from_mapping(read_settings(a.settings))


def _take(a: argparse.Namespace, task: Callable[[], None], source: Path, outputs: list[Path]) -> None:
    """Run a stage on one recording, which may be left out."""
    from expertaug_recordings.intake import take

    take(task, source, outputs, a.on_bad_recording, getattr(a, "sha256", None))


def _render_video(a: argparse.Namespace) -> None:
    from expertaug_recordings.rendering.render import render_recording
    from expertaug_recordings.settings import RenderVideoJob

    render_recording(a.index, a.output, a.truth, _job(a, RenderVideoJob))


def _extract_frames(a: argparse.Namespace) -> None:
    from expertaug_recordings.settings import ExtractFramesJob
    from expertaug_recordings.video.frame_store import extract_frames

    job = _job(a, ExtractFramesJob)
    _take(a, lambda: extract_frames(a.video, a.output, job), a.video, [a.output])


def _track_markers(a: argparse.Namespace) -> None:
    from expertaug_recordings.markers.track import track_markers
    from expertaug_recordings.settings import TrackMarkersJob

    job = _job(a, TrackMarkersJob)
    _take(a, lambda: track_markers(a.frames, a.output, job), a.frames, [a.output])


def _unpack_markers(a: argparse.Namespace) -> None:
    from expertaug_recordings.ibm import unpack_archive
    from expertaug_recordings.settings import UnpackMarkersJob

    unpack_archive(a.archive, a.output, _job(a, UnpackMarkersJob))


def _import_markers(a: argparse.Namespace) -> None:
    from expertaug_recordings.ibm import import_markers
    from expertaug_recordings.settings import ImportMarkersJob

    job = _job(a, ImportMarkersJob)
    _take(a, lambda: import_markers(a.csv, a.output, job), a.csv, [a.output])


def _measure_angles(a: argparse.Namespace) -> None:
    from expertaug_recordings.angles.measure import measure_angles
    from expertaug_recordings.settings import MeasureAnglesJob

    job, outputs = _job(a, MeasureAnglesJob), [a.output, a.summary]
    _take(a, lambda: measure_angles(a.markers, *outputs, job), a.markers, outputs)


def _summarise_recordings(a: argparse.Namespace) -> None:
    from expertaug_recordings.intake import divide
    from expertaug_recordings.reports.summary import summarise

    kept, refused = divide(a.summaries)
    summarise(kept, a.output, a.markdown, refused)


def _plot_recording(a: argparse.Namespace) -> None:
    from expertaug_recordings.intake import refusal
    from expertaug_recordings.reports.page import plot_recording, plot_refused

    reason = refusal(a.summary)
    if reason is None:
        plot_recording(a.markers, a.angles, a.summary, a.output)
    else:
        plot_refused(a.summary.parent.name, reason, a.output)


def _overlay(a: argparse.Namespace) -> None:
    from expertaug_recordings.intake import refusal
    from expertaug_recordings.reports.overlay import note, overlay
    from expertaug_recordings.settings import OverlayJob

    job = _job(a, OverlayJob)
    forecasts = dict(text.partition("=")[::2] for text in a.forecasts)
    for label, path in forecasts.items():
        if not (label and path):
            raise InputError("--forecasts", f"found '{label or path}'", "give LABEL=PATH")
    reason = refusal(a.angles)
    if reason is None:
        overlay(a.video, a.markers, a.angles, a.summary, a.output, job, forecasts)
    else:
        note(f"left out: {reason}", a.output)


def _review_recording(a: argparse.Namespace) -> None:
    from expertaug.files import write_text
    from expertaug_recordings.intake import refusal
    from expertaug_recordings.reports.review import review_recording
    from expertaug_recordings.settings import ReviewRecordingJob

    job = _job(a, ReviewRecordingJob)
    if (reason := refusal(a.angles)) is None:
        files = (a.video, a.markers, a.angles, a.summary, a.output, a.rows)
        review_recording(*files, job)
    else:
        write_text(a.output, reason)
        write_text(a.rows, reason)


def _review(a: argparse.Namespace) -> None:
    from expertaug_recordings.intake import divide
    from expertaug_recordings.reports.review import review

    kept, refused = divide(a.summaries)
    review(kept, a.output, refused)


def _export_recording(a: argparse.Namespace) -> None:
    from expertaug.files import write_text
    from expertaug_recordings.intake import refusal
    from expertaug_recordings.reports.exports import FILES, export_recording

    if (reason := refusal(a.angles)) is None:
        export_recording(a.markers, a.angles, a.output)
    else:
        for name in FILES:
            write_text(a.output / name, f"left out: {reason}\n")


def _inspect(a: argparse.Namespace) -> None:
    from expertaug_recordings.inspection.inspect import inspect
    from expertaug_recordings.settings import StatedTimes

    stated = {"rate_hz": a.rate, "times": a.times, "time_unit_s": a.time_unit}
    stated |= {"from_s": a.from_s, "to_s": a.to_s}
    known = StatedTimes.from_mapping({k: v for k, v in stated.items() if v is not None})
    text = inspect(a.videos, a.output, known)
    logger.info("%s: contact sheet", a.output)
    print(text, end="")


def _split_chunks(a: argparse.Namespace) -> None:
    from expertaug_recordings.chunks import split_chunks
    from expertaug_recordings.intake import divide
    from expertaug_recordings.settings import SplitChunksJob

    job = _job(a, SplitChunksJob)
    split_chunks(divide(a.angles)[0], a.output, job)


def _cut_horizon(a: argparse.Namespace) -> None:
    from expertaug_recordings.chunks import cut_horizon
    from expertaug_recordings.intake import divide
    from expertaug_recordings.settings import CutHorizonJob

    job = _job(a, CutHorizonJob)
    cut_horizon(divide(a.angles)[0], a.output, job)


def _plot_splits(a: argparse.Namespace) -> None:
    from expertaug_recordings.reports.splits import plot_splits

    plot_splits(a.data, a.output)
