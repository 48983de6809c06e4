"""Figure of the splits: initial angles, initial speeds and energies (the paper's appendix on the double pendulum)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.measurements.splitting import SPLITS
from expertaug.trajectories import Trajectories

COLOURS = {"train": "#0072B2", "validation": "#E69F00", "test": "#D55E00"}  # told apart by the colour-blind as well
PANELS = (r"$\theta_1$ [rad]", r"$\theta_2$ [rad]", r"$\dot\theta_1$ [rad/s]", r"$\dot\theta_2$ [rad/s]")


SINGLE = (r"$\theta$ [rad]", r"$\dot\theta$ [rad/s]")  # of a single pendulum


def run_stage(data_dir: str | Path, outputs: Sequence[str | Path] | str | Path) -> None:
    """Stage: draw how the initial angles, speeds and energies of train, validation and test chunks are distributed.

    Arguments:
        data_dir: what :func:`expertaug_recordings.chunks.split_chunks` wrote.
        outputs: one or more .png or .pdf files.

    Raises:
        InputError: a file of the splits is missing or does not fit the others.
    """
    data_dir = Path(data_dir)
    first = {name: _initial_states(data_dir / f"{name}.npz") for name in SPLITS}
    energies = _energies(data_dir / "chunks.csv", {name: len(y) for name, y in first.items()})
    with plotting.use_style():
        plotting.save(plot_splits(first, energies), outputs)


def plot_splits(first: Mapping[str, np.ndarray], energies: Mapping[str, np.ndarray]) -> Figure:
    """How the initial angles, speeds and energies of train, validation and test chunks are distributed.

    Arguments:
        first: first states (N, 4) of each set's chunks, of a single pendulum (N, 2).
        energies: their mean energies in s⁻², (N,).
    """
    with plotting.use_style():
        figure = plotting.new_figure(3.9)
        axes = figure.subplots(2, 3)
        single = next(iter(first.values())).shape[1] == len(SINGLE)
        places = (axes[0, 0], axes[1, 0]) if single else (axes[0, 0], axes[0, 1], axes[1, 0], axes[1, 1])
        for unused in (axes[0, 1], axes[1, 1]) if single else ():
            unused.axis("off")
        for k, (axis, label) in enumerate(zip(places, SINGLE if single else PANELS, strict=True)):
            values = {name: y[:, k] for name, y in first.items()}
            if k < len(places) // 2:
                values = {name: np.angle(np.exp(1j * v)) for name, v in values.items()}
                _histogram(axis, values, (-np.pi, np.pi), label)
                axis.set_xticks([-np.pi, 0, np.pi], [r"$-\pi$", "0", r"$\pi$"])
            else:
                _histogram(axis, values, _symmetric(values), label)
        top = max(float(np.quantile(e, 0.999)) for e in energies.values())
        _histogram(axes[0, 2], energies, (0.0, top), r"energy [s$^{-2}$]")
        axes[1, 2].axis("off")
        handles = [mpl.patches.Patch(facecolor=(COLOURS[n], 0.25), edgecolor=COLOURS[n], linewidth=1.2) for n in SPLITS]
        axes[1, 2].legend(handles, [f"{n} ({len(first[n]):,} chunks)" for n in SPLITS], loc="center")
        for axis in (axes[0, 0], axes[1, 0]):
            axis.set_ylabel("density")
    return figure


def _initial_states(path: Path) -> np.ndarray:
    """First states (N, 4) of a set's chunks."""
    y = Trajectories.load(path).y
    if y.ndim != 3 or y.shape[2] not in (len(PANELS), len(SINGLE)) or not len(y):
        raise InputError(
            path, f"y has shape {y.shape}", "chunks are (N, T, 4), of a single pendulum (N, T, 2): run split_chunks"
        )
    return y[:, 0]


def _energies(path: Path, counts: Mapping[str, int]) -> dict[str, np.ndarray]:
    """Mean energies of each set's chunks in s⁻², (N,)."""
    try:
        table = pd.read_csv(path, usecols=["split", "energy"], dtype={"split": str, "energy": float})
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run split_chunks") from error
    except (ValueError, OSError) as error:
        raise InputError(path, f"not a table of chunks ({error})", "run split_chunks again") from error
    energies = {name: table.loc[table["split"] == name, "energy"].dropna().to_numpy() for name in SPLITS}
    for name, count in counts.items():
        if len(energies[name]) != count:
            listed = f"energies of {len(energies[name])} {name} chunks, {name}.npz has {count}"
            raise InputError(path, listed, "run split_chunks again")
    return energies


def _histogram(axis: mpl.axes.Axes, values: Mapping[str, np.ndarray], limits: tuple[float, float], label: str) -> None:
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
