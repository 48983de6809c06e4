"""A user's file is merged with the defaults in the workflow as it is on the command line."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
TEXT = """
run: [pendulum]
methods: {later: {kind: hybrid, label: Later}}
experiments:
  pendulum:
    methods: [mean, later]
    augmented: []
    augmentations: {narrow: null, wide: null}
    model: {encoder: {kind: recurrent, hidden: 8}}
"""


def test_another_kind_brings_its_own_arguments_and_own_methods_come_last(tmp_path):
    (tmp_path / "my.yaml").write_text(TEXT)
    command = [sys.executable, "-m", "snakemake", "-s", str(ROOT / "Snakefile"), "-n", "-p", "--cores", "1"]
    done = subprocess.run(
        [*command, "--configfile", "my.yaml"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT / "src")},
        capture_output=True,
        text=True,
        timeout=120,
    )
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    settings = [json.loads(text) for text in re.findall(r"--settings '(\{.*?\})' ", said)]
    later = next(one for one in settings if one.get("method") == "later" and "model" in one)
    assert later["model"]["encoder"] == {"kind": "recurrent", "hidden": 8}
    methods = next(one["all_methods"] for one in settings if "all_methods" in one)
    assert methods[0] == "mean" and methods[-1] == "later"
