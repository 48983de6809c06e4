"""Draws the picture of the first page: ``python benchmarks/first_picture.py [--run RUN] [--output PNG]``.

How good forecasts are, by how slow the pendulum is: with the encoder as trained, after expert augmentation, and with a
fit of each window.  The numbers are those of a published run's table ``pendulum_distance.csv``; 1 is what the true
equation reaches through the noise, 0 the mean of the training set.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import pandas as pd
import yaml

from expertaug import plotting
from expertaug.hues import OWN

ROOT = Path(__file__).parents[1]
LINES = {
    "aphynity": "encoder as trained",
    "aphynity+": "encoder after expert augmentation",
    "alternating": "each window fitted, no encoder",
}


def main() -> None:
    """Draw it from the run's published table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, default=ROOT / "results/published/ten_seeds_pendulum")
    parser.add_argument("--output", type=Path, default=ROOT / "docs/images/first_page.png")
    options = parser.parse_args()
    table = pd.read_csv(options.run / "tables" / "pendulum_distance.csv")
    config = yaml.safe_load((options.run / "config.yaml").read_text(encoding="utf-8"))
    low, high = config["experiments"]["pendulum"]["data"]["sets"]["train"]["z_e"]["omega0"]
    colours = plotting.colours(list(LINES), OWN)
    with plotting.use_style():
        figure = plotting.new_figure(2.7, 6.0)
        axes = figure.add_subplot()
        axes.axvspan(low, high, color="0.93", zorder=0)
        axes.text(high - 0.05, 1.06, "trained here", ha="right", va="bottom", color="0.35")
        for version, label in LINES.items():
            part = table[(table["method"] == version) & (table["of"] == "z_e")]
            beyond, inside = part[part["distance"] > 0], part[part["distance"] == 0]
            omega0 = [*((low - beyond["distance"] * (high - low))[::-1]), (low + high) / 2]
            skill = [*beyond["skill"][::-1], *inside["skill"]]
            look = plotting.look(version, colours, 4)
            axes.hlines(inside["skill"], low, high, color=colours[version], linewidth=3, alpha=0.35)  # one bin
            axes.plot(omega0, skill, label=label, **look)
        for value, words in ((1.0, "as good as the true equation"), (0.0, "no better than the mean")):
            axes.axhline(value, color="0.55", linewidth=0.8, linestyle=":")
            axes.text(low + 0.02, value, words, va="bottom", color="0.35", fontsize=7)
        axes.set(xlabel="natural frequency of the pendulum [rad/s]", ylabel="skill of its forecast")
        axes.set(xlim=(0.5, high), ylim=(-0.2, 1.2))
        axes.legend(loc="center right", bbox_to_anchor=(1.0, 0.31))
        plotting.save(figure, options.output)


if __name__ == "__main__":
    main()
