"""Options that several subcommands share, and how they are read."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from expertaug.errors import InputError
from expertaug.stages.prior_file import read_ranges, with_ranges

if TYPE_CHECKING:
    from expertaug.settings import Raw
    from expertaug.tracking.settings import Tracking


def add_paths(parser: argparse.ArgumentParser, **options: str) -> None:
    """Required options that are paths, each with its help text."""
    for name, text in options.items():
        parser.add_argument(f"--{name}", type=Path, required=True, metavar="PATH", help=text)


def add_outputs(parser: argparse.ArgumentParser, text: str) -> None:
    """The option ``--output`` of a stage that writes the same in several formats."""
    parser.add_argument("--output", type=Path, nargs="+", required=True, help=text)


def add_tracking(parser: argparse.ArgumentParser) -> None:
    """The option that :func:`tracking_of` reads."""
    parser.add_argument("--tracking", type=Path, metavar="FILE", help="what init-tracking wrote; none: do not track")


def add_prior(parser: argparse.ArgumentParser) -> None:
    """The option of ranges of p⁺ that a stage's settings leave open (``prior: own``); see :func:`with_prior`."""
    parser.add_argument(
        "--prior", type=Path, metavar="FILE", help="what own-prior wrote, where p⁺ finds its own ranges"
    )


def with_prior(a: argparse.Namespace, settings: Raw) -> Raw:
    """A stage's settings with the ranges of ``--prior`` where p⁺ finds its own."""
    return with_ranges(settings, None if a.prior is None else read_ranges(a.prior))


def read_settings(text: str) -> Raw:
    """A stage's settings: JSON text, or the path of a JSON or YAML file.

    Raises:
        InputError: neither, or no mapping.
    """
    import yaml

    try:
        if not text.lstrip().startswith("{"):
            text = Path(text).read_text(encoding="utf-8")
        value = yaml.safe_load(text) if not text.lstrip().startswith("{") else json.loads(text)
    except OSError as error:
        raise InputError("--settings", f"{text}: {error.strerror}", "give JSON text or the path of a file") from error
    except (ValueError, RecursionError, yaml.YAMLError) as error:
        raise InputError("--settings", f"neither JSON nor YAML ({error})", "give a JSON object") from error
    if not isinstance(value, dict):
        raise InputError("--settings", f"holds {type(value).__name__}", "give a JSON object")
    return value


def tracking_of(arguments: argparse.Namespace) -> Tracking | None:
    """The tracking store that ``init-tracking`` prepared, for a stage that logs; None where it is switched off."""
    if arguments.tracking is None:
        return None
    from expertaug.files import read_json
    from expertaug.settings import read
    from expertaug.tracking.settings import Tracking

    marker = read_json(arguments.tracking)
    if not isinstance(marker, dict) or "enabled" not in marker:
        raise InputError(arguments.tracking, "does not say which tracking store", "make it again with init-tracking")
    if marker["enabled"] is False:
        return None
    return read(Tracking, marker | {"rule": arguments.stage}, str(arguments.tracking))
