"""The subcommand that runs the workflow gives Snakemake what the user says."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from expertaug.commands import parse, workflow
from expertaug.errors import InputError
from subcommands import call

ROOT = Path(__file__).parents[2]


def test_arguments_go_to_snakemake_as_they_are(tmp_path):
    arguments = ["--cores", "2", "-n", "--configfile", "config/smoke.yaml", "--", "tabulate"]
    found = workflow.command(ROOT, parse(["run", *arguments]).rest)
    assert found[-7:-1] == arguments[:-1] and found[-1] == "tabulate"
    assert f"--workflow-profile={ROOT / 'profiles/default'}" in found
    other = workflow.command(ROOT, ["--workflow-profile", "profiles/slurm"])
    assert other[-2:] == ["--workflow-profile", "profiles/slurm"] and len(other) == 7


def test_a_file_of_the_workflow_need_not_be_in_the_working_directory(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    smoke = ["--configfile", "config/smoke.yaml", "tabulate"]
    assert workflow.command(ROOT, smoke)[-2:] == [str(ROOT / "config/smoke.yaml"), "tabulate"]
    (tmp_path / "config").mkdir()
    (tmp_path / "config/smoke.yaml").touch()
    assert workflow.command(ROOT, smoke)[-2:] == ["config/smoke.yaml", "tabulate"], "one's own goes first"


def test_it_ends_as_snakemake_does_and_an_installation_without_the_workflow_says_so(monkeypatch):
    given = []
    monkeypatch.setattr(subprocess, "run", lambda line, **_: given.append(line) or SimpleNamespace(returncode=3))
    with pytest.raises(SystemExit) as stop:
        call(workflow, "run")
    assert stop.value.code == 3 and given == [workflow.command(ROOT, [])]
    monkeypatch.setattr("expertaug.source_files.project", lambda: None)
    with pytest.raises(InputError, match="this installation lacks the workflow"):
        call(workflow, "run")
