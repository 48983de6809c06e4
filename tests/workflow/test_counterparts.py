"""What docs/counterparts.md promises is what the workflow makes."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

import warm_python

ROOT = Path(__file__).parents[2]


@pytest.mark.slow
def test_every_counterpart_is_made_by_the_default_reproduction(tmp_path):
    named = set(re.findall(r"results/(?:tables|figures)/\w+\.\w+", (ROOT / "docs" / "counterparts.md").read_text()))
    assert len(named) > 15
    files = ["--snakefile", ROOT / "Snakefile", "--configfile", ROOT / "config" / "config.yaml"]
    done = subprocess.run(
        [warm_python.interpreter(), "-m", "snakemake", "--summary", *files],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    assert named - {line.split("\t")[0] for line in done.stdout.splitlines()} == set()
