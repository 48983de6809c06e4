"""An sdist, and the wheel that is built from it, hold all that a run of the workflow needs, and no more."""

import os
import re
import shutil
import subprocess
import sys
import tarfile
import zipfile
from fnmatch import fnmatch
from importlib.util import find_spec
from pathlib import Path

import pytest
from packaging.metadata import Metadata

import expertaug

ROOT = Path(__file__).parents[1]
FOLDERS = ("src", "workflow", "config", "profiles")
SOURCES = ("pyproject.toml", "setup.py", "README.md", "LICENSE", "Snakefile", *FOLDERS)  # of a wheel
OF_SDIST = ("MANIFEST.in", "CHANGELOG.md", "CITATION.cff", "constraints.txt")  # as well
SHIPPED = (*SOURCES, *OF_SDIST, "PKG-INFO", "setup.cfg", "results/published/*/costs.csv")
LEFT_OUT = ("tests", "results/published/smoke")  # but for its costs

PIP = ("pip", "--quiet", "--disable-pip-version-check")


def run(*command, **options) -> subprocess.CompletedProcess:
    done = subprocess.run([sys.executable, "-m", *command], text=True, capture_output=True, check=False, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> tuple[Path, Path]:
    """An sdist of a clean copy of the checkout, and a wheel made from it."""
    folder = tmp_path_factory.mktemp("built")
    tree = folder / "tree"
    for name in (*SOURCES, *OF_SDIST, *LEFT_OUT):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("*.egg-info", "__pycache__"))
        else:
            shutil.copy(ROOT / name, tree / name)
    build = f"from setuptools import build_meta; build_meta.build_sdist({str(folder)!r})"
    done = subprocess.run([sys.executable, "-c", build], cwd=tree, text=True, capture_output=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (sdist,) = folder.glob("expertaug-*.tar.gz")
    run(*PIP, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(sdist))
    (wheel,) = folder.glob("expertaug-*.whl")
    return sdist, wheel


@pytest.mark.slow
def test_an_sdist_has_what_a_wheel_is_built_from_and_no_more(built):
    with tarfile.open(built[0]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames() if archive.getmember(name).isfile()}
    carried = [path for name in FOLDERS[1:] for path in (ROOT / name).rglob("*") if path.is_file()]
    assert {str(path.relative_to(ROOT)) for path in carried if path.suffix != ".pyc"} <= names
    besides = {name for name in names if name.partition("/")[0] not in FOLDERS}
    assert [name for name in besides if not any(fnmatch(name, shipped) for shipped in SHIPPED)] == []
    assert "results/published/smoke/costs.csv" in besides


def test_what_is_built_has_sound_metadata(built):
    sdist, wheel = built
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        told = Metadata.from_email(archive.read(name), validate=True)
    assert str(told.version) == expertaug.__version__ and told.license_expression == "MIT"
    assert told.description == (ROOT / "README.md").read_text(encoding="utf-8")
    if find_spec("twine"):
        run("twine", "check", "--strict", str(sdist), str(wheel))


@pytest.mark.slow
def test_an_installed_wheel_plans_the_small_run_without_a_checkout(built, tmp_path):
    site, away = tmp_path / "site", tmp_path / "away"
    away.mkdir()
    wheel = built[1]
    run(*PIP, "install", "--no-deps", "--target", str(site), str(wheel))

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
