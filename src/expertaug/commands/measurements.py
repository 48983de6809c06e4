"""Subcommands about measurements of one's own: tables of times and columns."""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

from expertaug.commands.options import Commands, add_paths, read_settings

logger = logging.getLogger(__name__)


def add_to(commands: Commands) -> None:
    """Add this module's subcommands."""
    p = commands.add("cut-measurements", _cut_measurements, "cut measurements into chunks and split them")
    p.add_argument("files", type=Path, nargs="+", help="tables: CSV, Parquet or NPZ")
    add_paths(p, output="folder of the sets")

    p = commands.add("cut-measured-horizon", _cut_measured_horizon, "cut long chunks out of the points of a split")
    p.add_argument("files", type=Path, nargs="+", help="tables: CSV, Parquet or NPZ")
    add_paths(p, output="npz of the set")

    p = commands.add(
        "inspect-data", _inspect_data, "show what tables hold and propose their configuration", settings=False
    )
    p.add_argument("files", nargs="+", metavar="FILE", help="tables or globs: CSV, Parquet or NPZ")
    text = "system whose components the columns are: a name, or JSON with name and arguments (default: none)"
    p.add_argument("--system", metavar="NAME", help=text)
    p.add_argument("--time", metavar="COLUMN", help="the column of times (default: by its name)")
    p.add_argument(
        "--trajectory", metavar="COLUMN", help="the column that tells trajectories apart (default: by its name)"
    )
    text = "unit of a column, such as 'theta=deg' (default: as its header says); may be given several times"
    p.add_argument("--unit", metavar="COLUMN=UNIT", action="append", default=[], help=text)
    text = "picture, .png or .pdf"
    p.add_argument("--output", type=Path, default=Path("data.png"), metavar="PATH", help=text)


def _inspect_data(a: argparse.Namespace) -> None:
    from expertaug.measurements.inspect import Inspection
    from expertaug.measurements.proposal import proposal

    names, priors, settings = None, {}, None
    if a.system is not None:
        from expertaug import systems

        settings = read_settings(a.system) if a.system.lstrip().startswith("{") else {"name": a.system}
        system = systems.load(settings)
        names = systems.names(system)
        priors = {p.name: [(0.3 if p.positive else -3.0) * p.scale, 3.0 * p.scale] for p in system.expert_parameters}
    units = dict(text.rpartition("=")[::2] for text in a.unit)
    found = Inspection(a.files, names, a.time, a.trajectory, units)
    for line in found.lines():
        print(f"# {line}")
    found.draw(a.output)
    logger.info("%s: picture", a.output)
    print(proposal(found, settings, priors), end="")


def _cut_measurements(a: argparse.Namespace) -> None:
    from expertaug import systems
    from expertaug.measurements.settings import CutMeasurementsJob
    from expertaug.measurements.stage import cut_measurements

    job = CutMeasurementsJob.from_mapping(read_settings(a.settings))
    cut_measurements(a.files, a.output, job.files, systems.names(systems.load(job.system)))


def _cut_measured_horizon(a: argparse.Namespace) -> None:
    from expertaug import systems
    from expertaug.measurements.horizons import cut_measured_horizon
    from expertaug.measurements.settings import CutMeasuredHorizonJob

    job = CutMeasuredHorizonJob.from_mapping(read_settings(a.settings))
    cut_measured_horizon(a.files, a.output, job.files, job.set, systems.names(systems.load(job.system)))
