"""The rule of the report page, as a dry run of one experiment sees it."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
from itertools import pairwise

from test_overrides import TEXT, plan


def report_settings(done: subprocess.CompletedProcess) -> dict:
    """What the stage report is told by a planned run."""
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    words = shlex.split(next(line for line in said.splitlines() if "expertaug report" in line))
    told = dict(pairwise(words))
    assert told["--output"] == "results/mine/report.html" and told["--results"] == "results/mine"
    return json.loads(told["--settings"])


def test_the_report_shows_what_rules_mark_under_their_captions(tmp_path):
    done = plan(tmp_path, TEXT)
    said, settings = done.stdout + done.stderr, report_settings(done)
    assert [one["name"] for one in settings["experiments"]] == ["pendulum"] and settings["files"][-1] == "my.yaml"
    shown = {one["path"]: one for one in settings["shown"]}
    assert {"tables/pendulum.md", "figures/pendulum_forecasts.png", "figures/log_mse.png"} <= shown.keys()
    assert shown["tables/pendulum_alarm.md"]["title"] == "alarm"
    for path, one in shown.items():
        assert f"results/mine/{path}" in said, "a job makes it"
        assert (tmp_path / one["caption"]).resolve().is_file()


def test_the_rule_graph_is_snakemakes_own(tmp_path):
    settings = report_settings(plan(tmp_path, TEXT))
    done = plan(tmp_path, TEXT, "--rulegraph", "mermaid-js")
    names = dict(re.findall(r"(id\d+)\[(\w+)\]", done.stdout))
    arrows = {(names[a], names[b]) for a, b in re.findall(r"(id\d+) --> (id\d+)", done.stdout)}
    assert len(settings["rules"]) > 10
    assert {tuple(one) for one in settings["rules"]} == {
        (a, b) for a, b in arrows if b not in ("everything", "write_report")
    }
