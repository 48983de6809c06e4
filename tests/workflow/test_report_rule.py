"""The rule of the report page, as a dry run of one experiment sees it."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest
from test_overrides import TEXT, plan

from expertaug.stages.planned import STUDIES


@pytest.fixture(scope="module")
def planned(tmp_path_factory) -> tuple[Path, subprocess.CompletedProcess]:
    """A folder with a configuration of one's own, and what a dry run of it says."""
    folder = tmp_path_factory.mktemp("report")
    return folder, plan(folder, TEXT)


def report_settings(done: subprocess.CompletedProcess) -> dict:
    """What the stage report is told by a planned run."""
    said = done.stdout + done.stderr
    assert done.returncode == 0, said
    words = shlex.split(next(line for line in said.splitlines() if "expertaug report" in line))
    told = dict(pairwise(words))
    assert told["--output"] == "results/mine/report.html" and told["--results"] == "results/mine"
    return json.loads(told["--settings"])


def test_the_report_shows_what_rules_mark_under_their_captions(planned):
    folder, done = planned
    said, settings = done.stdout + done.stderr, report_settings(done)
    assert [one["name"] for one in settings["experiments"]] == ["pendulum"] and settings["files"][-1] == "my.yaml"
    shown = {one["path"]: one for one in settings["shown"]}
    assert {"tables/pendulum.md", "figures/pendulum_forecasts.png", "figures/log_mse.png"} <= shown.keys()
    assert shown["tables/pendulum_alarm.md"]["title"] == "alarm"
    for path, one in shown.items():
        assert f"results/mine/{path}" in said, "a job makes it"
        assert (folder / one["caption"]).resolve().is_file()


def stage_of(rule: str) -> str:
    """The stage that a rule runs, by the rule's name."""
    name = re.sub(r"_(of_experiment|experiment|of_recording|seed_group|set|all)$", "", rule)
    name = {"plot_overview": "overview", "plot_page": "plot_recording"}.get(name, name)
    return STUDIES[name].key() if rule == f"{name}_of_experiment" and name in STUDIES else name


def test_the_graph_of_stages_is_that_of_snakemakes_rules(planned):
    folder, done = planned
    settings = report_settings(done)
    done = plan(folder, TEXT, "--rulegraph", "mermaid-js")
    names = dict(re.findall(r"(id\d+)\[(\w+)\]", done.stdout))
    arrows = {(names[a], names[b]) for a, b in re.findall(r"(id\d+) --> (id\d+)", done.stdout)}
    assert len(settings["rules"]) > 10
    assert {tuple(one) for one in settings["rules"]} == {
        (stage_of(a), stage_of(b)) for a, b in arrows if b not in ("everything", "write_report")
    }
