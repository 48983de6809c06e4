"""One table of all recordings: how well they were tracked and what their motion implies."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from expertaug.errors import InputError
from expertaug.files import atomic, read_json, write_text
from expertaug.recordings.archive import natural_key

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
    "implied_rate_hz": ("implied rate [Hz]", "{:.1f}"),
    "B1": ("B1", "{:.4f}"),
    "G1": ("G1 [s⁻²]", "{:.2f}"),
    "B2": ("B2", "{:.3f}"),
    "G2": ("G2 [s⁻²]", "{:.2f}"),
    "r2": ("R² (θ1, θ2)", "{}"),
    "energy": ("energy start → end [s⁻²]", "{}"),
}


def summarise(summaries: Sequence[str | Path], csv: str | Path, markdown: str | Path) -> None:
    """Write the table of recordings as CSV (every value) and Markdown (rounded), in natural order.

    Arguments:
        summaries: the ``angles.json`` of each recording.
        csv, markdown: outputs.

    Raises:
        InputError: no summaries, or one that lacks a value.
    """
    if not summaries:
        raise InputError(csv, "no recordings to summarise", "run measure_angles")
    rows = sorted((_row(Path(path)) for path in summaries), key=lambda row: natural_key(str(row["recording"])))
    with atomic(csv) as temporary:
        pd.DataFrame(rows).to_csv(temporary, index=False, float_format="%.8g")
    lines = ["| " + " | ".join(heading for heading, _ in HEADINGS.values()) + " |", "|" + "---|" * len(HEADINGS)]
    for row in rows:
        cells = {
            **row,
            "arm1": f"{row['arm1_px']:.2f} ± {row['arm1_std_px']:.2f}",
            "arm2": f"{row['arm2_px']:.2f} ± {row['arm2_std_px']:.2f}",
            "noise": f"{row['noise1_deg']:.3f}, {row['noise2_deg']:.3f}",
            "r2": f"{row['r2_1']:.4f}, {row['r2_2']:.4f}",
            "energy": f"{row['energy_start']:.0f} → {row['energy_end']:.1f}",
        }
        lines.append("| " + " | ".join(form.format(cells[key]) for key, (_, form) in HEADINGS.items()) + " |")
    sources = sorted({str(row["rate_provenance"]) for row in rows})
    lines += ["", f"Frame rate: {'; '.join(sources)}. The implied rate is the one at which G2/B2 = g/l1 holds.", ""]
    write_text(markdown, "\n".join(lines))


def _row(path: Path) -> dict[str, object]:
    summary = read_json(path)
    try:
        row = {key: value for key, value in summary.items() if key not in ("constants", "friction")}
        row |= summary["constants"]
        wanted = ("recording", "arm1_px", "noise1_deg", "implied_rate_hz", "B1", "r2_1")
        missing = [key for key in wanted if key not in row]
    except (AttributeError, KeyError, TypeError):
        missing = ["constants"]
    if missing:
        raise InputError(path, f"no {missing[0]} in it", "run measure_angles again")
    return row
