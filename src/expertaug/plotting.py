"""One look for all figures: sizes, colours by method, text of names, and saving."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Literal, Required, TypeAlias, TypedDict

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, StrMethodFormatter
from matplotlib.typing import ColorType, LineStyleType, MarkerType

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.hues import EQUATION, FLOOR, HUES, assign_hues
from expertaug.versions import Version, base

WIDTH = 7.0  # inches: the text width of a page
NOTE = "nothing to draw"  # what a PNG of words alone says of itself
DPI = 200
RC = {
    "font.family": "DejaVu Sans",
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.7,
    "axes.axisbelow": True,
    "grid.color": "0.88",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "figure.dpi": DPI,
    "savefig.dpi": DPI,
    "pdf.fonttype": 42,
    "svg.hashsalt": "expertaug",
}
DASHED, DASH_DOTTED = (0, (3.5, 1.6)), (0, (6.0, 1.6, 1.0, 1.6))
LONG_DASHED = (0, (8.0, 1.6))
LETTERS = "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|rho|sigma|tau|phi|chi|psi|omega"


Colour: TypeAlias = tuple[float, float, float]
Colours: TypeAlias = Mapping[str, Colour]  # of versions


class Look(TypedDict, total=False):
    """How a line or a point is drawn, in matplotlib's words."""

    color: Required[ColorType]
    linestyle: LineStyleType
    linewidth: float
    marker: MarkerType
    markersize: float


def colours(variants: Sequence[str], hues: Mapping[str, int] | None = None) -> dict[str, Colour]:
    """A colour for each version of a method: one hue per method, light as trained, dark when augmented.

    Arguments:
        variants: to be drawn (:mod:`expertaug.versions`).
        hues: indices of :data:`~expertaug.hues.HUES` by method, of a whole configuration, so that a method has one
            colour in all its figures. Methods without one get what is free.
    """
    drawn = list(dict.fromkeys(map(base, variants)))
    hues, colour_of = assign_hues([drawn], hues), {}
    for variant in variants:
        if hues[base(variant)] == FLOOR:
            colour_of[variant] = to_rgb(EQUATION)
            continue
        red, green, blue = to_rgb(HUES[hues[base(variant)]])
        if Version.parse(variant).is_augmented:
            colour_of[variant] = (0.72 * red, 0.72 * green, 0.72 * blue)
        else:
            colour_of[variant] = tuple(0.58 * part + 0.42 for part in (red, green, blue))
    return colour_of


def dash(variant: str) -> LineStyleType:
    """The style of a version's line, for versions of one colour: dotted when refined, long dashes for a flow,
    dash-dotted when a control, solid when augmented, else dashed."""
    version = Version.parse(variant)
    if version.is_refined:
        return (0, (1, 1))
    if version.is_flow:
        return LONG_DASHED
    if version.is_control:
        return DASH_DOTTED
    return "-" if version.is_augmented else DASHED


def whiskers(values: Sequence[float], lows: Sequence[float], highs: Sequence[float]) -> np.ndarray:
    """Lengths (2, n) of error bars below and above values (n,); 0 where an end is not known.

    Rounding may put an end that is the value itself a little beyond it: all windows may have one estimate.
    """
    middle = np.asarray(values, dtype=float)
    return np.nan_to_num([middle - np.asarray(lows), np.asarray(highs) - middle]).clip(0)


def marker(variant: str) -> str:
    """The marker on a version's line."""
    version = Version.parse(variant)
    return "s" if version.is_refined else "^" if version.is_flow else "v" if version.is_control else "o"


def look(variant: str, colours: Colours, size: float = 3) -> Look:
    """Colour, dash and marker of a version's line; the true equation's is dotted, without markers, in every figure."""
    if colours[variant] == to_rgb(EQUATION):
        return {"color": EQUATION, "linestyle": ":", "marker": ""}
    return {
        "color": colours[variant],
        "linestyle": dash(variant),
        "marker": marker(variant),
        "markersize": size,
    }


def symbol(name: str) -> str:
    """A parameter's or state's name as it is printed: ``omega0`` becomes ω with index 0."""
    match = re.fullmatch(rf"({LETTERS}|[A-Za-z])_?(\d*)", name)
    if match is None:
        return name.replace("_", " ")
    stem = match[1] if len(match[1]) == 1 else rf"\{match[1]}"
    return f"${stem}_{{{match[2]}}}$" if match[2] else f"${stem}$"


def text(words: str) -> str:
    """Words as a figure prints them: the model's symbols (``z_a``, ``F_a``) with their index; printed ones stay."""
    return re.sub(r"(?<!\$)\b([zF])_([ae])\b", r"$\1_\2$", words)


def wrap_words(words: str, width: float, size: float = RC["axes.titlesize"]) -> str:
    """Words in lines of at most so many inches, about, at a font size in points; longer words stay whole."""
    return textwrap.fill(words, max(1, int(width / (0.55 * size / 72))), break_long_words=False, break_on_hyphens=False)


def quantity(name: str, unit: str) -> str:
    """Symbol and unit of an axis; a pure number's is 1."""
    return f"{symbol(name)} [{unit or 1}]"


def plain_log(axes: Axes, which: Literal["x", "y"] = "y") -> None:
    """Make an axis logarithmic, with plain numbers; what is drawn already decides how many, and whether it can be."""
    if not log_scaled(axes, which):
        return
    axis = axes.xaxis if which == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    between, ticks = (30, 4) if which == "x" else (1000, 5)  # of x, labels lie side by side
    decades = LogLocator(subs=(1, 2, 5) if high < between * low else (1,))
    axis.set_major_locator(MaxNLocator(ticks) if high < 5 * low else decades)
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def log_scaled(axes: Axes, which: Literal["x", "y"] = "y") -> bool:
    """Make an axis logarithmic where anything that is drawn is above 0; whether it is now."""
    limits = axes.dataLim
    some = bool(np.isfinite(limits.minposx if which == "x" else limits.minposy))
    if some:
        axes.set(**{f"{which}scale": "log"})
    return some


def new_figure(height: float, width: float = WIDTH) -> Figure:
    """An empty figure in inches that needs no display."""
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.get_layout_engine().set(w_pad=0.06, h_pad=0.06)
    FigureCanvasAgg(figure)
    return figure


def heading(figure: Figure, words: str) -> None:
    """A line above all panels that says what the figure is of."""
    figure.suptitle(words, fontsize=RC["axes.titlesize"])


def legend(figure: Figure, handles: Sequence[Artist]) -> None:
    """One legend below all panels, in as many columns as fit (entries fill them top to bottom)."""
    for handle in handles:
        handle.set_label(text(str(handle.get_label())))
    # Inches at the legend's font size.
    widths = [0.5 + 0.055 * len(handle.get_label().replace("$", "")) for handle in handles]
    columns = len(handles)
    while columns > 1 and sum(map(max, np.array_split(widths, columns))) > figure.get_figwidth() - 0.1:
        rows = -(-len(handles) // (columns - 1))
        columns = -(-len(handles) // rows)
    figure.legend(handles=list(handles), loc="outside lower center", ncols=columns)


def note(words: str) -> Figure:
    """A figure that says only why there is nothing to draw: what a workflow expects is then there all the same."""
    with use_style():
        figure = new_figure(0.8, 5.2)
        figure.set_label(NOTE)
        figure.text(0.5, 0.5, wrap_words(words, 5.0, RC["font.size"]), ha="center", va="center", color="0.35")
    return figure


def use_style() -> AbstractContextManager:
    """The context in which figures are made and saved."""
    return mpl.rc_context(RC)


def save(figure: Figure, outputs: str | Path | Iterable[str | Path], dpi: float | None = None) -> None:
    """Write a figure as PNG or PDF by suffix, atomically; a path without either suffix means both.

    A figure of the same numbers is the same file: it has no date in it.

    Arguments:
        dpi: resolution; default that of the style in which it is saved.

    Raises:
        InputError: another suffix, or the file cannot be written.
    """
    listed = [outputs] if isinstance(outputs, str | Path) else list(outputs)
    for output in map(Path, listed):
        if output.suffix and output.suffix not in (".png", ".pdf"):
            raise InputError(output, f"suffix {output.suffix!r}", "figures are .png or .pdf")
        for path in [output] if output.suffix else [output.with_suffix(".png"), output.with_suffix(".pdf")]:
            metadata: dict[str, str | None] = {"CreationDate" if path.suffix == ".pdf" else "Software": None}
            if path.suffix == ".png" and figure.get_label() == NOTE:
                metadata["Comment"] = NOTE
            with atomic(path) as temporary:
                figure.savefig(temporary, dpi=dpi or mpl.rcParams["savefig.dpi"], metadata=metadata)
            figure.set_layout_engine("none")  # the places are found: a third of the time of a further file


def save_all(figures: Mapping[Path, Figure]) -> None:
    """Save figures, each as :func:`save` does at its path, in the style in which they were drawn."""
    with use_style():
        for path, figure in figures.items():
            save(figure, path)
