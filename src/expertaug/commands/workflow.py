"""The subcommand that runs the workflow, from a checkout or from the copy inside an installed package."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

_PROFILES = ("--profile", "--workflow-profile")


def add_to(add: Callable[..., argparse.ArgumentParser]) -> None:
    """Add this module's subcommands."""
    text = "run the workflow: snakemake with the Snakefile of this package; results go below the working directory"
    examples = """
    expertaug run --cores 2 --configfile config/smoke.yaml    # the small run
    expertaug run --cores 2                                   # the default reproduction
    expertaug run -n pendulum                                 # what one experiment would do
    """
    p = add("run", _run, text, "use", examples)
    p.usage = "expertaug run [-h] [SNAKEMAKE'S ARGUMENTS]"
    p.description = "A file of the workflow, as config/smoke.yaml, need not be in the working directory."
    p.set_defaults(rest=[])


def _run(a: argparse.Namespace) -> None:
    from expertaug.errors import InputError
    from expertaug.source_files import project

    folder = project()
    if folder is None:
        raise InputError("expertaug", "this installation lacks the workflow", "install from a wheel or a checkout")
    raise SystemExit(subprocess.run(command(folder, a.rest), check=False).returncode)


def command(folder: Path, arguments: Sequence[str]) -> list[str]:
    """Snakemake's command line.

    Arguments:
        folder: that holds the workflow.
        arguments: the user's; paths of files that are not here but in ``folder`` become paths there.
    """
    resolved = [
        str(folder / a) if not a.startswith("-") and not Path(a).exists() and (folder / a).is_file() else a
        for a in arguments
    ]
    profile = f"--workflow-profile={folder / 'profiles' / 'default'}"
    profile = [] if any(a.split("=")[0] in _PROFILES for a in resolved) else [profile]
    return [sys.executable, "-m", "snakemake", "--snakefile", str(folder / "Snakefile"), *profile, *resolved]
