"""Where results come from: the checkout's revision and no other's, this machine, the versions that are installed."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

import expertaug
from expertaug.tracking import provenance


def answers(monkeypatch, status: int, said: str) -> list[str]:
    """What git is asked for, which answers so."""
    asked: list[str] = []

    def run(command, **_):
        asked.append(command[1])
        return SimpleNamespace(returncode=status, stdout=said)

    monkeypatch.setattr(subprocess, "run", run)
    return asked


def test_the_revision_is_that_of_a_checkout_that_has_this_package(monkeypatch):
    asked = answers(monkeypatch, 0, "abc-dirty\n")
    assert provenance.revision() == "abc-dirty" and asked == ["ls-files", "describe"]


def test_below_somebody_elses_checkout_there_is_no_revision(monkeypatch):
    asked = answers(monkeypatch, 1, "theirs")
    assert provenance.revision() is None and asked == ["ls-files"]


def test_without_git_there_is_no_revision(monkeypatch):
    def run(*_, **__):
        raise FileNotFoundError("git")

    monkeypatch.setattr(subprocess, "run", run)
    assert provenance.revision() is None


@pytest.mark.skipif(not Path("/proc/cpuinfo").exists(), reason="Linux tells of its processors there")
def test_the_machine_has_the_processors_that_linux_counts():
    found = provenance.machine()
    assert found["cores"] == len(re.findall(r"^processor\s*:", Path("/proc/cpuinfo").read_text(), re.M)) > 0
    assert found["python"] == platform.python_version()


def test_versions_are_those_that_are_installed_and_others_are_left_out(monkeypatch):
    monkeypatch.setattr(provenance, "PACKAGES", ("numpy", "no-such-package-of-anybody"))
    assert provenance.versions() == {"expertaug": expertaug.__version__, "numpy": importlib.metadata.version("numpy")}
