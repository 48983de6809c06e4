"""Figure of the splits: initial angles, initial speeds and energies (the paper's appendix on the double pendulum)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from expertaug.errors import InputError
from expertaug.files import atomic
from expertaug.recordings.chunks.splitting import SPLITS
from expertaug.trajectories import Trajectories

COLOURS = {"train": "#0072B2", "validation": "#E69F00", "test": "#D55E00"}  # told apart by the colour-blind as well
STYLE = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "pdf.fonttype": 42,
    "legend.frameon": False,
}
PANELS = (r"$\theta_1$ [rad]", r"$\theta_2$ [rad]", r"$\dot\theta_1$ [rad/s]", r"$\dot\theta_2$ [rad/s]")


def plot_splits(data_dir: str | Path, outputs: Sequence[str | Path] | str | Path) -> None:
    """Draw how the initial angles, speeds and energies of train, validation and test chunks are distributed.

    Arguments:
        data_dir: what :func:`expertaug.recordings.chunks.cut.split_chunks` wrote.
        outputs: one or more .png or .pdf files.

    Raises:
        InputError: a file of the splits is missing.
    """
    data_dir = Path(data_dir)
    outputs = [outputs] if isinstance(outputs, str | Path) else list(outputs)
    first = {name: Trajectories.load(data_dir / f"{name}.npz").y[:, 0] for name in SPLITS}
    try:
        table = pd.read_csv(data_dir / "chunks.csv")
    except FileNotFoundError as error:
        raise InputError(data_dir / "chunks.csv", "no such file", "run split_chunks") from error
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.0, 3.9), layout="constrained")
        FigureCanvasAgg(figure)
        axes = figure.subplots(2, 3)
        places = (axes[0, 0], axes[0, 1], axes[1, 0], axes[1, 1])
        for k, (axis, label) in enumerate(zip(places, PANELS, strict=True)):
            values = {name: y[:, k] for name, y in first.items()}
            if k < 2:
                values = {name: np.angle(np.exp(1j * v)) for name, v in values.items()}
                _histogram(axis, values, (-np.pi, np.pi), label)
                axis.set_xticks([-np.pi, 0, np.pi], [r"$-\pi$", "0", r"$\pi$"])
            else:
                _histogram(axis, values, _symmetric(values), label)
        energies = {name: table.loc[table["split"] == name, "energy"].to_numpy() for name in SPLITS}
        top = max(float(np.quantile(e, 0.999)) for e in energies.values())
        _histogram(axes[0, 2], energies, (0.0, top), r"energy [s$^{-2}$]")
        axes[1, 2].axis("off")
        handles = [mpl.patches.Patch(facecolor=(COLOURS[n], 0.25), edgecolor=COLOURS[n], linewidth=1.2) for n in SPLITS]
        axes[1, 2].legend(handles, [f"{n} ({len(first[n]):,} chunks)" for n in SPLITS], loc="center")
        for axis in (axes[0, 0], axes[1, 0]):
            axis.set_ylabel("density")
        for output in outputs:
            with atomic(output) as temporary:
                # Without a date the same chunks give the same bytes.
                dateless = {"CreationDate": None} if temporary.suffix == ".pdf" else None
                figure.savefig(temporary, dpi=300, metadata=dateless)


def _histogram(axis: mpl.axes.Axes, values: dict[str, np.ndarray], limits: tuple[float, float], label: str) -> None:
    edges = np.linspace(*limits, 41)
    for name, v in values.items():
        density, _ = np.histogram(v, edges, density=True)
        axis.stairs(density, edges, fill=True, alpha=0.25, color=COLOURS[name])
        axis.stairs(density, edges, color=COLOURS[name], linewidth=1.2)
    axis.set_xlabel(label)
    axis.set_xlim(limits)
    axis.set_ylim(bottom=0)
    axis.locator_params(axis="y", nbins=4)


def _symmetric(values: dict[str, np.ndarray]) -> tuple[float, float]:
    reach = max(float(np.quantile(np.abs(v), 0.999)) for v in values.values())
    return -reach, reach
