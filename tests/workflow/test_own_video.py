"""A user's own clip, from what inspect prints to the tables."""

import sys
from pathlib import Path

import pandas as pd
import pytest
import yaml
from running import copy_project, snakemake

sys.path.append(str(Path(__file__).parents[1] / "recordings"))
from test_rates import filmed
from test_single import SWING, clip

from expertaug_recordings.inspection.inspect import inspect

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
QUICK = {"validity": {"samples": 4, "steps": 2}}


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_single_pendulum_from_inspect_to_tables(tmp_path):
    project = copy_project(tmp_path / "project")
    (project / "my").mkdir()
    clip(project / "my" / "swing.mp4", ("red", "green"))
    (project / "my.yaml").write_text(inspect(project / "my" / "swing.mp4", project / "contact.png"))
    (project / "swing.yaml").write_text(yaml.safe_dump(SWING | {"results": "results/mine", "seeds": [0]}))
    (project / "quick.yaml").write_text(yaml.safe_dump({"experiments": {"swing": QUICK}}))
    files = ["--configfile", "my.yaml", "swing.yaml", "quick.yaml"]
    done = snakemake(project, *files)
    assert done.returncode == 0, done.stdout + done.stderr
    made = project / "results" / "mine"
    scores = pd.read_csv(made / "tables" / "swing_long.csv").query("metric == 'log_mse_dim' and set == 'test'")
    error = dict(zip(scores.method, scores["mean"], strict=True))
    assert set(error) == set(SWING["experiments"]["swing"]["methods"])
    assert max(e for method, e in error.items() if method != "mean") < error["mean"] - 3, error
    more = snakemake(project, "review", "export", "overlay", *files)
    assert more.returncode == 0, more.stdout + more.stderr
    assert "swing" in (made / "recordings" / "review.html").read_text()
    assert (made / "recordings" / "swing" / "export" / "tracker.csv").exists()
    assert (made / "recordings" / "swing" / "overlay.mp4").stat().st_size > 10_000
