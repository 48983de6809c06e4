"""A user's own clip, from what inspect prints to the tables."""

import sys
from pathlib import Path

import pytest
import yaml
from running import copy_project, snakemake

sys.path.append(str(Path(__file__).parents[1] / "recordings"))
from test_rates import filmed

from expertaug.recordings.inspection.inspect import inspect

LITTLE = {
    "run": ["double_pendulum"],
    "results": "results/mine",
    "seeds": [0],
    "experiments": {
        "double_pendulum": {
            "methods": ["mean", "expert_only"],
            "augmented": [],
            "controls": [],
            "flows": [],
            "refined": [],
            "studies": {"during_training": None},
            "evaluation": {"samples": 1},
            "training": {"epochs": 1},
        }
    },
}


@pytest.mark.parametrize("rate", [38])
def test_from_inspect_to_tables(tmp_path, rate):
    project = copy_project(tmp_path / "project")
    (project / "my").mkdir()
    filmed(project / "my", rate)
    text = inspect(project / "my" / "clip.mp4", project / "contact.png")
    (project / "my.yaml").write_text(text)
    (project / "little.yaml").write_text(yaml.safe_dump(LITTLE))
    done = snakemake(project, "--configfile", "my.yaml", "little.yaml")
    assert done.returncode == 0, done.stdout + done.stderr
    tables = project / "results" / "mine" / "tables"
    assert "Expert only" in (tables / "double_pendulum.md").read_text()
    review = snakemake(project, "review", "export", "--configfile", "my.yaml", "little.yaml")
    assert review.returncode == 0, review.stdout + review.stderr
    made = project / "results" / "mine" / "recordings"
    assert "clip" in (made / "review.html").read_text() and (made / "clip" / "export" / "tracker.csv").exists()
