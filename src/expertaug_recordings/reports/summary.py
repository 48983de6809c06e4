"""One table of all recordings: how well they were tracked and what their motion implies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic, write_text
from expertaug.measurements.paths import natural_key
from expertaug_recordings.angles.summary import RecordingSummary
from expertaug_recordings.settings import RENDERED

# Columns of the table: key in a recording's summary → heading and format of the Markdown table.
HEADINGS = {
    "recording": ("recording", "{}"),
    "frames": ("frames", "{}"),
    "duration_s": ("duration [s]", "{:.1f}"),
    "tracked_share": ("tracked [%]", "{:.2%}"),
    "usable_share": ("usable [%]", "{:.2%}"),
    "arm1": ("arm 1 [px]", "{}"),
    "arm2": ("arm 2 [px]", "{}"),
    "noise": ("angle noise [°]", "{}"),
    "gaps": ("gaps", "{}"),
    "longest_gap_frames": ("longest gap [frames]", "{}"),
    "interpolated": ("interpolated [frames]", "{}"),
    "rate_hz": ("rate [Hz]", "{:g}"),
    "implied": ("implied rate [Hz]", "{}"),
    "B1": ("B1", "{:.4f}"),
    "G1": ("G1 [s⁻²]", "{:.2f}"),
    "B2": ("B2", "{:.3f}"),
    "G2": ("G2 [s⁻²]", "{:.2f}"),
    "r2": ("R² (θ1, θ2)", "{}"),
    "energy": ("energy start → end [s⁻²]", "{}"),
}


def summarise(
    summaries: Sequence[str | Path], csv: str | Path, markdown: str | Path, refused: Mapping[str, str] | None = None
) -> None:
    """Write the table of recordings as CSV (every value) and Markdown (rounded), in natural order.

    Arguments:
        summaries: the ``angles.json`` of each recording.
        csv, markdown: outputs.
        refused: recordings that were left out, and why.

    Raises:
        InputError: no summaries, or one that lacks a value.
    """
    if not summaries:
        raise InputError(csv, "no recordings to summarise", "run measure_angles")
    rows = sorted((_row(Path(path)) for path in summaries), key=lambda row: natural_key(str(row["recording"])))
    with atomic(csv) as temporary:
        left_out = [{"recording": name, "refused": reason} for name, reason in (refused or {}).items()]
        table = sorted([*rows, *left_out], key=lambda row: natural_key(str(row["recording"])))
        pd.DataFrame(table).to_csv(temporary, index=False, float_format="%.8g")
    lines = ["| " + " | ".join(heading for heading, _ in HEADINGS.values()) + " |", "|" + "---|" * len(HEADINGS)]
    for row in rows:
        cells = {
            **row,
            "arm1": f"{row['arm1_px']:.2f} ± {row['arm1_std_px']:.2f}",
            "arm2": f"{row['arm2_px']:.2f} ± {row['arm2_std_px']:.2f}",
            "noise": f"{row['noise1_deg']:.3f}, {row['noise2_deg']:.3f}",
            "implied": _implied(row),
            "r2": f"{row['r2_1']:.4f}, {row['r2_2']:.4f}",
            "energy": f"{row['energy_start']:.0f} → {row['energy_end']:.1f}",
        }
        if row["pendulum"] == "single":
            cells |= dict.fromkeys(("arm2", "B1", "B2", "G2"), "–")
            cells |= {"noise": f"{row['noise1_deg']:.3f}", "r2": f"{row['r2_1']:.4f}"}
        lines.append(
            "| "
            + " | ".join(
                (cells[key] if cells[key] == "–" else form.format(cells[key])) for key, (_, form) in HEADINGS.items()
            )
            + " |"
        )
    if refused:
        lines += ["", "Left out (recordings.on_bad_recording is skip):", ""]
        lines += [f"- {name}: {refused[name]}" for name in sorted(refused, key=natural_key)]
    warned = [f"- {row['recording']}: {row['warnings']}" for row in rows if row["warnings"]]
    lines += ["", "Warnings:", "", *warned] if warned else []
    sources = sorted({str(row["rate_provenance"]) for row in rows})
    lines += ["", f"Frame rate: {'; '.join(sources)}. The implied rate is the one at which G2/B2 = g/l1 holds.", ""]
    write_text(markdown, "\n".join(lines))


def _implied(row: Mapping) -> str:
    """What was rendered moves by the real recordings' constants in their nominal time: that is no finding."""
    known = row["implied_rate_hz"] is not None and row["rate_provenance"] != RENDERED
    return f"{row['implied_rate_hz']:.1f}" if known else "–"


def _row(path: Path) -> dict[str, object]:
    found = RecordingSummary.load(path).model_dump()
    apart = ("constants", "friction", "timing")
    row = {key: value for key, value in found.items() if key not in apart} | found["constants"] | found["timing"]
    row["error_deg"] = "; ".join(f"{value:.3g}" for value in found["timing"]["error_deg"] or ())
    row["reasons"] = "; ".join(f"{reason} {count}" for reason, count in found["reasons"].items())
    row["warnings"] = "; ".join(found["warnings"])
    return row
