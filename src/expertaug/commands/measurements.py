"""Subcommands about measurements of one's own: tables of times and columns."""

from __future__ import annotations

import argparse
from pathlib import Path

from expertaug.commands.options import Commands, add_paths, read_settings


def add_to(commands: Commands) -> None:
    """Add this module's subcommands."""
    p = commands.add("cut-measurements", _cut_measurements, "cut measurements into chunks and split them")
    p.add_argument("files", type=Path, nargs="+", help="tables: CSV, Parquet or NPZ")
    add_paths(p, output="folder of the sets")


def _cut_measurements(a: argparse.Namespace) -> None:
    from expertaug import systems
    from expertaug.measurements.cut import cut_measurements

    settings = read_settings(a.settings)
    cut_measurements(a.files, a.output, settings["files"], systems.names(systems.load(settings["system"])))
