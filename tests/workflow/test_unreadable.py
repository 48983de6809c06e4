"""Configuration files that Snakemake cannot read, and targets that are none, end in one line each."""

import subprocess

import pytest
from running import ROOT

import warm_python
from nightly import others_slow
from snakemake_logger_plugin_expertaug import configuration_files, refusals


@pytest.mark.parametrize(
    "arguments, files",
    [
        (["--cores", "1"], []),
        (["--configfile", "a.yaml", "b.yaml", "--cores", "1", "target"], ["a.yaml", "b.yaml"]),
        (["-n", "--configfile=a.yaml", "--configfiles", "b.yaml"], ["a.yaml", "b.yaml"]),
        (["--config", "results=x", "--configfile", "a.yaml"], ["a.yaml"]),
    ],
)
def test_the_files_of_a_command_line(arguments, files):
    assert configuration_files(arguments) == files


def test_what_can_be_read_is_not_refused():
    assert refusals(["--configfile", str(ROOT / "config/smoke.yaml")]) == ""


def test_each_file_that_cannot_be_read_gets_its_line(tmp_path):
    broken = tmp_path / "broken.yaml"
    broken.write_text("a: [1\nb: }", encoding="utf-8")
    command = [warm_python.interpreter(), "-m", "snakemake", "-n", "--cores", "1", "--directory", str(tmp_path)]
    command += ["--snakefile", str(ROOT / "Snakefile"), "--workflow-profile", str(ROOT / "profiles/default")]
    command += ["--configfile", "missing.yaml", str(broken)]
    run = subprocess.run(command, text=True, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    said = [line for line in run.stdout.splitlines() if "profile" not in line]
    assert run.returncode != 0
    assert said == [
        "configuration: missing.yaml: cannot be read (No such file or directory); give a configuration file",
        f"configuration: {broken}:2:2: not YAML (expected ',' or ']', but got ':'); correct that line",
    ]


@pytest.mark.parametrize(
    ("target", "said"),
    others_slow(
        [
            ("pendulm", "target: nothing makes 'pendulm'; did you mean pendulum?"),
            ("evalute", "target: nothing makes 'evalute'; did you mean evaluate?"),
            ("zzz", "target: nothing makes 'zzz'; targets are all, everything, render_video,"),
        ]
    ),
)
def test_a_misspelt_target_gets_a_suggestion(target, said, tmp_path):
    command = [warm_python.interpreter(), "-m", "snakemake", "-n", "--cores", "1", "--directory", str(tmp_path)]
    command += ["--snakefile", str(ROOT / "Snakefile"), "--workflow-profile", str(ROOT / "profiles/default"), target]
    run = subprocess.run(command, text=True, check=False, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert run.returncode != 0
    lines = run.stdout.splitlines()
    assert [line for line in lines if line.startswith(said)] and "MissingRuleException" not in run.stdout, run.stdout
