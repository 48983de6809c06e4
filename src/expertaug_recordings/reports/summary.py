"""One table of all recordings: how well they were tracked and what their motion implies."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic, write_text
from expertaug.measurements.paths import natural_key
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.settings import RENDERED

CONSTANTS = ("B1", "G1", "B2", "G2")


def run_stage(
    summaries: Sequence[str | Path], csv: str | Path, markdown: str | Path, refused: Mapping[str, str] | None = None
) -> None:
    """Stage: write the table of recordings as CSV (every value) and Markdown (rounded), in natural order.

    Arguments:
        summaries: the ``angles.json`` of each recording.
        csv, markdown: outputs.
        refused: recordings that were left out, and why.

    Raises:
        InputError: no summaries, or one that lacks a value.
    """
    table, text = summarise(list(map(RecordingSummary.load, summaries)), refused, csv)
    with atomic(csv) as temporary:
        table.to_csv(temporary, index=False, float_format="%.8g")
    write_text(markdown, text)


def summarise(
    recordings: Sequence[RecordingSummary], refused: Mapping[str, str] | None = None, where: object = "recordings"
) -> tuple[pd.DataFrame, str]:
    """The table of recordings with every value, and as Markdown (rounded), in natural order.

    Arguments:
        refused: recordings that were left out, and why.
        where: what a message calls the table.

    Raises:
        InputError: there are no recordings.
    """
    if not recordings:
        raise InputError(where, "no recordings to summarise", "run measure_angles")
    measured = sorted(recordings, key=lambda recording: natural_key(recording.recording))
    left_out = refused or {}
    cells = {recording.recording: _cells(recording) for recording in measured}
    cells |= {name: {"recording": name, "refused": reason} for name, reason in left_out.items()}
    table = pd.DataFrame([cells[name] for name in sorted(cells, key=natural_key)])
    rows = [_print_row(recording) for recording in measured]
    lines = [_line(rows[0]), "|" + "---|" * len(rows[0]), *(_line(row.values()) for row in rows)]
    if left_out:
        lines += ["", "Left out (recordings.on_bad_recording is skip):", ""]
        lines += [f"- {name}: {left_out[name]}" for name in sorted(left_out, key=natural_key)]
    warned = [
        f"- {recording.recording}: {'; '.join(recording.warnings)}" for recording in measured if recording.warnings
    ]
    lines += ["", "Warnings:", "", *warned] if warned else []
    sources = sorted({recording.rate_provenance for recording in measured})
    lines += ["", f"Frame rate: {'; '.join(sources)}. The implied rate is the one at which G2/B2 = g/l1 holds.", ""]
    return table, "\n".join(lines)


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _print_row(recording: RecordingSummary) -> dict[str, str]:
    """The Markdown table's row by heading; of a single pendulum what belongs to a second arm is left out."""
    b1, g1, b2, g2 = (recording.constants[name] for name in CONSTANTS)
    double = recording.pendulum == "double"
    # What was rendered moves by the real recordings' constants in their nominal time: that is no finding.
    implied = recording.implied_rate_hz is not None and recording.rate_provenance != RENDERED
    return {
        "recording": recording.recording,
        "frames": str(recording.frames),
        "duration [s]": f"{recording.duration_s:.1f}",
        "tracked [%]": f"{recording.tracked_share:.2%}",
        "usable [%]": f"{recording.usable_share:.2%}",
        "arm 1 [px]": f"{recording.arm1_px:.2f} ± {recording.arm1_std_px:.2f}",
        "arm 2 [px]": f"{recording.arm2_px:.2f} ± {recording.arm2_std_px:.2f}" if double else "–",
        "angle noise [°]": f"{recording.noise1_deg:.3f}" + (f", {recording.noise2_deg:.3f}" if double else ""),
        "gaps": str(recording.gaps),
        "longest gap [frames]": str(recording.longest_gap_frames),
        "interpolated [frames]": str(recording.interpolated),
        "rate [Hz]": f"{recording.rate_hz:g}",
        "implied rate [Hz]": f"{recording.implied_rate_hz:.1f}" if implied else "–",
        "B1": f"{b1:.4f}" if double else "–",
        "G1 [s⁻²]": f"{g1:.2f}",
        "B2": f"{b2:.3f}" if double else "–",
        "G2 [s⁻²]": f"{g2:.2f}" if double else "–",
        "R² (θ1, θ2)": f"{recording.r2_1:.4f}" + (f", {recording.r2_2:.4f}" if double else ""),
        "energy start → end [s⁻²]": f"{recording.energy_start:.0f} → {recording.energy_end:.1f}",
    }


def _cells(recording: RecordingSummary) -> dict[str, object]:
    """The CSV's row by column: every value."""
    apart = {"constants", "friction", "timing"}
    error = "; ".join(f"{value:.3g}" for value in recording.timing.error_deg or ())
    reasons = "; ".join(f"{reason} {count}" for reason, count in recording.reasons.items())
    timing = recording.timing.model_dump() | {"error_deg": error}
    off = "; ".join(f"{value:.3g}" for value in recording.misfit_deg or ())
    texts = {"reasons": reasons, "misfit_deg": off, "warnings": "; ".join(recording.warnings)}
    return recording.model_dump(exclude=apart) | texts | recording.constants | timing
