"""A wheel holds all that a run of the workflow needs."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import expertaug
from expertaug.commands import parse, workflow

ROOT = Path(__file__).parents[1]
SOURCES = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "Snakefile", "src", "workflow", "config", "profiles")


def run(*command, **options) -> subprocess.CompletedProcess:
    done = subprocess.run([sys.executable, "-m", *command], text=True, capture_output=True, check=False, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def test_an_installed_wheel_plans_the_small_run_without_a_checkout(tmp_path):
    tree, site, away = tmp_path / "tree", tmp_path / "site", tmp_path / "away"
    away.mkdir()
    for name in SOURCES:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        copy(ROOT / name, tree / name)
    shutil.copytree(ROOT / "results/published/smoke", tree / "results/published/smoke")
    pip = ("pip", "--quiet", "--disable-pip-version-check")
    run(*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(tmp_path), str(tree))
    (wheel,) = tmp_path.glob("expertaug-*.whl")
    run(*pip, "install", "--no-deps", "--target", str(site), str(wheel))

    assert wheel.name.startswith(f"expertaug-{expertaug.__version__}-")
    environment = {**os.environ, "PYTHONPATH": str(site)}
    smoke = ("--cores", "1", "--configfile", "config/smoke.yaml")
    said = run("expertaug.cli", "run", "-n", *smoke, cwd=away, env=environment).stdout
    assert "This was a dry-run" in said and "train_seed_group" in said


def test_the_version_is_one_number():
    said = run("expertaug.cli", "--version").stdout.strip()
    cited = re.search(r"^version: (.+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    newest = re.search(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert cited and newest and said == expertaug.__version__ == cited[1] == newest[1]


def test_arguments_go_to_snakemake_as_they_are(tmp_path):
    arguments = ["--cores", "2", "-n", "--configfile", "config/smoke.yaml", "--", "tabulate"]
    found = workflow.command(ROOT, parse(["run", *arguments]).rest)
    assert found[-7:-1] == arguments[:-1] and found[-1] == "tabulate"
    assert f"--workflow-profile={ROOT / 'profiles/default'}" in found
    other = workflow.command(ROOT, ["--workflow-profile", "profiles/slurm"])
    assert other[-2:] == ["--workflow-profile", "profiles/slurm"] and len(other) == 7
