"""Frames to look at: the worst of each recording on a sheet, and all recordings on one page."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic, write_text
from expertaug.measurements.paths import natural_key
from expertaug.measurements.splitting import stretches
from expertaug_recordings.angles.quality import MEASURED
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.corrections import COLUMNS
from expertaug_recordings.markers.appearance import ROLES
from expertaug_recordings.reports import drawing
from expertaug_recordings.settings import ReviewRecordingJob
from expertaug_recordings.tables import PLACES, read_table
from expertaug_recordings.video.source import open_frames

WORST, WIDTH, ACROSS = 12, 320, 4  # frames on a sheet, their width in px, and how many are side by side
ORDINARY = ("margin", "short_stretch")  # reasons that say nothing of the frame itself


def worst_frames(quality: np.ndarray, reason: np.ndarray, off: np.ndarray) -> np.ndarray:
    """Rows to look at, ascending: the middle of the longest flagged runs, half of them at most; then measured frames
    whose arms are furthest off their lengths, one of each neighbourhood.

    Arguments:
        quality, reason: of the rows (n,).
        off: by how much their arms are off (n,), in any unit; NaN where that is not known.
    """
    flagged = (quality < MEASURED) & ~np.isin(reason, ORDINARY)
    runs = sorted(stretches(flagged), key=lambda run: run[0] - run[1])[: WORST // 2]
    rows = [(start + stop - 1) // 2 for start, stop in runs]
    left = np.where((quality == MEASURED) & np.isfinite(off), off, -1.0)
    apart = max(1, len(quality) // 100)
    while len(rows) < WORST and left.max() > 0:
        row = int(np.argmax(left))
        rows.append(row)
        left[max(0, row - apart) : row + apart + 1] = -1.0
    return np.array(sorted(rows), dtype=int)


@dataclass(frozen=True)
class WorstFrame:
    """A frame to look at.

    Attributes:
        frame: its number, as the markers' table has it.
        source: its row there.
        place: of the markers, (3, 2) px.
        reason: why it is flagged; empty where it is not.
        off: by how much its arms are off, as a share.
    """

    frame: int
    source: int
    place: np.ndarray
    reason: str
    off: float


def look_for_worst(points: pd.DataFrame, table: pd.DataFrame, summary: RecordingSummary) -> list[WorstFrame]:
    """A recording's worst frames, in order of time.

    Arguments:
        points: frame and places of the markers, :data:`~expertaug_recordings.tables.PLACES`, of each analysed frame.
        table: of the angles: t, quality, reason, and source: rows of ``points``.
    """
    source = table["source"].to_numpy(int)
    place = points[list(PLACES)].to_numpy().reshape(-1, 3, 2)[source]
    length = np.linalg.norm(np.diff(place, axis=1), axis=2)
    off = np.abs(length / (summary.arm1_px, summary.arm2_px) - 1).max(axis=1)
    reason, quality = table["reason"].to_numpy(), table["quality"].to_numpy()
    number = points["frame"].to_numpy()
    return [
        WorstFrame(int(number[source[row]]), int(source[row]), place[row], reason[row], float(off[row]))
        for row in worst_frames(quality, reason, off)
    ]


def corrections_of(worst: Sequence[WorstFrame], recording: str) -> pd.DataFrame:
    """Frames in the layout of corrections (:mod:`expertaug_recordings.corrections`), with reasons."""
    lines = [
        [recording, each.frame, name, *each.place[k], each.reason] for each in worst for k, name in enumerate(ROLES)
    ]
    return pd.DataFrame(lines, columns=[*COLUMNS, "reason"])


def review_recording(
    video: str | Path,
    markers: str | Path,
    angles: str | Path,
    summary: str | Path,
    sheet: str | Path,
    rows: str | Path,
    job: ReviewRecordingJob,
) -> None:
    """Stage: draw a recording's worst frames with the markers that were found in them.

    Arguments:
        video: the recording's.
        markers, angles, summary: what the stage measure-angles read and wrote.
        sheet: .jpg or .png.
        rows: CSV of these frames in the layout of corrections (:mod:`expertaug_recordings.corrections`), with reasons:
            to be mended and kept as a file of corrections.
        job: how the video's frames are opened.

    Raises:
        InputError: a file cannot be used or does not fit the others.
    """
    points = read_table(markers, ("frame", *PLACES), made_by="track_markers")
    table = read_table(angles, ("t", "quality", "source"), ("reason",))
    recording_summary = RecordingSummary.load(summary)
    source = table["source"].to_numpy(int)
    if not ((source >= 0) & (source < len(points))).all():
        raise InputError(markers, f"{len(points)} frames, {angles} has {len(table)}", "run measure_angles again")
    worst = look_for_worst(points, table, recording_summary)
    with open_frames(video, job) as frames:
        step = max(1, int(np.floor(frames.rate_hz / recording_summary.rate_hz + 1e-3)))
        wanted = {each.source * step: each for each in worst}
        tiles = {}
        for number, image in frames.frames(step):
            if number in wanted:
                tiles[number] = draw_tile(image, wanted[number])
            if len(tiles) == len(wanted):
                break
    with atomic(sheet) as temporary:
        if not cv2.imwrite(str(temporary), draw_sheet([tiles[number] for number in sorted(tiles)])):
            raise InputError(sheet, "cannot be written as an image", "name it .jpg")
    with atomic(rows) as temporary:
        corrections_of(worst, recording_summary.recording).to_csv(temporary, index=False, float_format="%.2f")


def draw_tile(image: np.ndarray, worst: WorstFrame) -> np.ndarray:
    """A frame (height, width, 3) as the sheet shows it: small, with its markers and why it is there."""
    factor = WIDTH / image.shape[1]
    small = drawing.resize(image, factor)
    drawing.pendulum(small, worst.place * factor, 8)
    words = f"frame {worst.frame}: {worst.reason or f'arms off by {worst.off:.1%}'}"
    drawing.text(small, words, (6, 16), size=0.4)
    return cv2.copyMakeBorder(small, 0, 4, 0, 4, cv2.BORDER_CONSTANT, value=(40, 40, 40))


def draw_sheet(tiles: Sequence[np.ndarray]) -> np.ndarray:
    """Tiles side by side, and below each other; where there are none, that is said."""
    if not tiles:
        tiles = [np.full((60, WIDTH, 3), 40, np.uint8)]
        drawing.text(tiles[0], "no frame stands out", (6, 30))
    tiles = [*tiles, *[np.full_like(tiles[0], 40)] * (-len(tiles) % min(ACROSS, len(tiles)))]
    across = min(ACROSS, len(tiles))
    return np.concatenate([np.concatenate(tiles[k : k + across], axis=1) for k in range(0, len(tiles), across)])


@dataclass(frozen=True)
class ReviewedRecording:
    """What the page says of a recording.

    Attributes:
        summary: of its measurement.
        sheet: of its worst frames, a JPEG's content.
        rows: text of the CSV of these frames.
    """

    summary: RecordingSummary
    sheet: bytes
    rows: str


def review(summaries: Sequence[str | Path], output: str | Path, refused: Mapping[str, str] | None = None) -> None:
    """Stage: write one page, which needs no other file, with each recording's numbers, warnings and worst frames.

    Arguments:
        summaries: angles.json of each recording; review.jpg and review.csv lie beside them.
        output: .html.
        refused: recordings that were left out, and why.

    Raises:
        InputError: a file is missing.
    """
    paths = sorted(map(Path, summaries), key=lambda path: natural_key(path.parent.name))
    write_text(output, review_page(map(_read_reviewed, paths), (refused or {}).items()))


def _read_reviewed(path: Path) -> ReviewedRecording:
    """Of a recording's angles.json and what lies beside it."""
    summary, folder = RecordingSummary.load(path), path.parent
    try:
        sheet = (folder / "review.jpg").read_bytes()
        return ReviewedRecording(summary, sheet, (folder / "review.csv").read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(folder, f"{Path(error.filename).name} cannot be read", "run draw-worst-frames") from error


def review_page(recordings: Iterable[ReviewedRecording], refused: Iterable[tuple[str, str]] = ()) -> str:
    """One page, which needs no other file, with each recording's numbers, warnings and worst frames.

    Arguments:
        recordings: in the order of the page.
        refused: names of recordings that were left out, and why.
    """
    parts = []
    for recording in recordings:
        summary, image = recording.summary, base64.b64encode(recording.sheet).decode()
        reasons = ", ".join(f"{name} {count}" for name, count in summary.reasons.items()) or "none"
        warned = "".join(f"<p class=warning>{html.escape(text)}</p>" for text in summary.warnings)
        parts.append(
            f"<h2>{html.escape(summary.recording)}</h2><p>{summary.frames} frames at {summary.rate_hz:g} Hz, used"
            f" {summary.usable_share:.2%}; flagged: {html.escape(reasons)}</p>{warned}"
            f'<img src="data:image/jpeg;base64,{image}" alt="worst frames"><details><summary>rows for a file of'
            f" corrections</summary><pre>{html.escape(recording.rows)}</pre></details>"
        )
    parts += [f"<h2>{html.escape(name)}</h2><p class=warning>{html.escape(why)}</p>" for name, why in refused]
    style = "body{font-family:sans-serif;margin:2em}img{max-width:100%}.warning{color:#B00020}"
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Recordings</title><style>{style}</style>'
    return f"{head}<h1>Recordings</h1>{''.join(parts)}</html>\n"
