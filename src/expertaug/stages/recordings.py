"""Stages from a video or a file of markers to chunks of angles."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from expertaug.errors import InputError
from expertaug.stages.options import add_outputs, add_paths
from expertaug.stages.stage import Stage

if TYPE_CHECKING:
    from expertaug.evaluation.products import Product
    from expertaug_recordings import settings as jobs

MARKERS = ("track_markers", "import_markers")  # stages that write them


def _add_intake(parser: argparse.ArgumentParser, checksum: bool = False) -> None:
    text = "a recording that is refused: stop, or skip it and write why into the outputs"
    parser.add_argument("--on-bad-recording", choices=("stop", "skip"), default="stop", help=text)
    if checksum:
        parser.add_argument("--sha256", metavar="HEX", help="checksum that the file must have")


def _add_measured(parser: argparse.ArgumentParser, **more: str) -> None:
    add_paths(
        parser, markers="CSV of the marker positions", angles="CSV of the angles", summary="JSON of the calibration"
    )
    add_paths(parser, **more)


def _take(a: argparse.Namespace, task: Callable[[], object], source: Path, outputs: list[Path]) -> None:
    """Run a stage on one recording, which may be left out."""
    from expertaug_recordings.intake import take

    take(task, source, outputs, a.on_bad_recording, getattr(a, "sha256", None))


class RenderVideo(Stage):
    """simulate a recording and render it as video"""

    name = "render-video"
    code = "expertaug_recordings.rendering.render"
    job = "expertaug_recordings.settings:RenderVideoJob"
    slice = "expertaug.config.recording_settings:render_video"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("--index", type=int, required=True, help="number of the recording, from 0")
        add_paths(parser, output="video", truth="CSV of the true motion")

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.RenderVideoJob) -> None:
        from expertaug_recordings.rendering.render import run_stage

        run_stage(a.index, a.output, a.truth, job)


class ExtractFrames(Stage):
    """decode a video into a frame store"""

    name = "extract-frames"
    code = "expertaug_recordings.video.frame_store"
    job = "expertaug_recordings.settings:ExtractFramesJob"
    slice = "expertaug.config.recording_settings:extract_frames"
    reads = ("render_video",)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("video", type=Path)
        add_paths(parser, output="frame store")
        _add_intake(parser, checksum=True)

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.ExtractFramesJob) -> None:
        from expertaug_recordings.video.frame_store import run_stage

        _take(a, lambda: run_stage(a.video, a.output, job), a.video, [a.output])


class TrackMarkers(Stage):
    """find the markers in every frame"""

    name = "track-markers"
    code = "expertaug_recordings.markers.track"
    job = "expertaug_recordings.settings:TrackMarkersJob"
    slice = "expertaug.config.recording_settings:track_markers"
    reads = ("render_video", "extract_frames")

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("frames", type=Path)
        add_paths(parser, output="CSV of the marker positions")
        _add_intake(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.TrackMarkersJob) -> None:
        from expertaug_recordings.markers.track import run_stage

        _take(a, lambda: run_stage(a.frames, a.output, job), a.frames, [a.output])


class UnpackMarkers(Stage):
    """unpack an archive of marker CSVs"""

    name = "unpack-markers"
    code = "expertaug_recordings.ibm"
    job = "expertaug_recordings.settings:UnpackMarkersJob"
    slice = "expertaug.config.recording_settings:unpack_markers"

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("archive", type=Path)
        add_paths(parser, output="folder")

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.UnpackMarkersJob) -> None:
        from expertaug_recordings.ibm import unpack_archive

        unpack_archive(a.archive, a.output, job)


class ImportMarkers(Stage):
    """convert a marker CSV of the IBM layout"""

    name = "import-markers"
    code = "expertaug_recordings.ibm"
    job = "expertaug_recordings.settings:ImportMarkersJob"
    slice = "expertaug.config.recording_settings:import_markers"
    reads = ("unpack_markers",)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("csv", type=Path)
        add_paths(parser, output="CSV of the marker positions")
        _add_intake(parser, checksum=True)

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.ImportMarkersJob) -> None:
        from expertaug_recordings.ibm import import_markers

        _take(a, lambda: import_markers(a.csv, a.output, job), a.csv, [a.output])


class MeasureAngles(Stage):
    """measure arm angles, speeds and energy"""

    name = "measure-angles"
    code = "expertaug_recordings.angles.measure"
    job = "expertaug_recordings.settings:MeasureAnglesJob"
    slice = "expertaug.config.recording_settings:measure_angles"
    reads = MARKERS

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("markers", type=Path)
        add_paths(parser, output="CSV of the angles", summary="JSON of the recording's calibration")
        _add_intake(parser)

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.MeasureAnglesJob) -> None:
        from expertaug_recordings.angles.measure import run_stage

        _take(a, lambda: run_stage(a.markers, a.output, a.summary, job), a.markers, [a.output, a.summary])


class SummariseRecordings(Stage):
    """make the table of recordings"""

    name = "summarise-recordings"
    code = "expertaug_recordings.reports.summary"
    reads = ("measure_angles",)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("summaries", type=Path, nargs="+", help="angles.json of each recording")
        add_paths(parser, output="CSV", markdown="Markdown")

    @staticmethod
    def run(a: argparse.Namespace, job: None) -> None:
        from expertaug_recordings.intake import divide
        from expertaug_recordings.reports.summary import run_stage

        kept, refused = divide(a.summaries)
        run_stage(kept, a.output, a.markdown, refused)


class PlotRecording(Stage):
    """draw a recording's page of the report"""

    name = "plot-recording"
    code = "expertaug_recordings.reports.page"
    reads = (*MARKERS, "measure_angles")

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        _add_measured(parser, output="figure, .png or .pdf")

    @staticmethod
    def run(a: argparse.Namespace, job: None) -> None:
        from expertaug import plotting
        from expertaug_recordings.intake import refusal
        from expertaug_recordings.reports.page import plot_refused, run_stage

        reason = refusal(a.summary)
        if reason is None:
            run_stage(a.markers, a.angles, a.summary, a.output)
        else:
            plotting.save_all({a.output: plot_refused(a.summary.parent.name, reason)})


class Overlay(Stage):
    """draw markers, arms, angles and forecasts over a recording's video"""

    name = "overlay"
    code = "expertaug_recordings.reports.overlay"
    job = "expertaug_recordings.settings:OverlayJob"
    slice = "expertaug.config.recording_settings:overlay"
    reads = (*MARKERS, "measure_angles")

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("video", type=Path)
        _add_measured(parser, output="video, .mp4")
        parser.add_argument("--forecasts", nargs="*", default=[], metavar="LABEL=PATH", help="forecasts.npz to draw")

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.OverlayJob) -> None:
        from expertaug_recordings.intake import refusal
        from expertaug_recordings.reports.overlay import note, run_stage

        forecasts = dict(text.partition("=")[::2] for text in a.forecasts)
        for label, path in forecasts.items():
            if not (label and path):
                raise InputError("--forecasts", f"found '{label or path}'", "give LABEL=PATH")
        reason = refusal(a.angles)
        if reason is None:
            run_stage(a.video, a.markers, a.angles, a.summary, a.output, job, forecasts)
        else:
            note(f"left out: {reason}", a.output)


class ReviewRecording(Stage):
    """draw a recording's worst frames"""

    name = "draw-worst-frames"
    former = ("review-recording",)
    code = "expertaug_recordings.reports.review"
    job = "expertaug_recordings.settings:ReviewRecordingJob"
    slice = "expertaug.config.recording_settings:review_recording"
    reads = (*MARKERS, "measure_angles")

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("video", type=Path)
        _add_measured(parser, output="sheet, .jpg or .png", rows="CSV of these frames, to be corrected")

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.ReviewRecordingJob) -> None:
        from expertaug.files import write_text
        from expertaug_recordings.intake import refusal
        from expertaug_recordings.reports.review import review_recording

        if (reason := refusal(a.angles)) is None:
            review_recording(a.video, a.markers, a.angles, a.summary, a.output, a.rows, job)
        else:
            write_text(a.output, reason)
            write_text(a.rows, reason)


class Review(Stage):
    """make the page of all recordings' worst frames"""

    name = "review"
    code = "expertaug_recordings.reports.review"
    reads = ("measure_angles", "draw_worst_frames")

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        text = "angles.json of each recording, with its review beside it"
        parser.add_argument("summaries", type=Path, nargs="+", help=text)
        add_paths(parser, output="page, .html")

    @staticmethod
    def run(a: argparse.Namespace, job: None) -> None:
        from expertaug_recordings.intake import divide
        from expertaug_recordings.reports.review import review

        kept, refused = divide(a.summaries)
        review(kept, a.output, refused)


class ExportRecording(Stage):
    """write a recording in formats of other programs"""

    name = "export-recording"
    code = "expertaug_recordings.reports.exports"
    reads = (*MARKERS, "measure_angles")

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        add_paths(parser, markers="CSV of the marker positions", angles="CSV of the angles", output="folder")

    @staticmethod
    def run(a: argparse.Namespace, job: None) -> None:
        from expertaug.files import write_text
        from expertaug_recordings.intake import refusal
        from expertaug_recordings.reports.exports import FILES, run_stage

        if (reason := refusal(a.angles)) is None:
            run_stage(a.markers, a.angles, a.output)
        else:
            for name in FILES:
                write_text(a.output / name, f"left out: {reason}\n")


class SplitChunks(Stage):
    """cut recordings into chunks and split them"""

    name = "split-chunks"
    code = "expertaug_recordings.chunks"
    job = "expertaug_recordings.settings:SplitChunksJob"
    slice = "expertaug.config.recording_settings:split_chunks"
    reads = ("measure_angles",)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("angles", type=Path, nargs="+", help="angles.csv of each recording")
        add_paths(parser, output="folder of the sets")

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.SplitChunksJob) -> None:
        from expertaug_recordings.chunks import split_chunks
        from expertaug_recordings.intake import divide

        split_chunks(divide(a.angles)[0], a.output, job)


class CutHorizon(Stage):
    """cut longer chunks out of the frames of each set"""

    name = "cut-horizon"
    code = "expertaug_recordings.chunks"
    job = "expertaug_recordings.settings:CutHorizonJob"
    slice = "expertaug.config.recording_settings:cut_horizon"
    reads = ("measure_angles",)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("angles", type=Path, nargs="+", help="angles.csv of each recording")
        add_paths(parser, output="npz of the set")

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.CutHorizonJob) -> None:
        from expertaug_recordings.chunks import cut_horizon
        from expertaug_recordings.intake import divide

        cut_horizon(divide(a.angles)[0], a.output, job)


class PlotSplits(Stage):
    """draw the distributions of the splits"""

    name = "plot-splits"
    code = "expertaug_recordings.reports.splits"
    reads = ("split_chunks",)

    @classmethod
    def products(cls) -> tuple[Product, ...]:
        from expertaug.evaluation.products import Product

        return (Product("splits", figure=True),)

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("data", type=Path, help="folder of the sets")
        add_outputs(parser, "figure files, .png or .pdf")

    @staticmethod
    def run(a: argparse.Namespace, job: None) -> None:
        from expertaug_recordings.reports.splits import run_stage

        run_stage(a.data, a.output)


class Calibrate(Stage):
    """fit the expert's constants on training chunks"""

    name = "calibrate"
    code = "expertaug_recordings.angles.calibration"
    job = "expertaug_recordings.settings:CalibrateJob"
    slice = "expertaug.config.recording_settings:calibrate"
    reads = ("split_chunks", "cut_measurements")

    @staticmethod
    def add_arguments(parser: argparse.ArgumentParser) -> None:
        parser.add_argument("train", type=Path, help="train.npz")
        add_paths(parser, output="JSON of the constants")

    @staticmethod
    def run(a: argparse.Namespace, job: jobs.CalibrateJob) -> None:
        from expertaug_recordings.angles.calibration import run_stage

        run_stage(a.train, a.output, job)
