"""Where results come from: revision, package versions, machine."""

from __future__ import annotations

import platform
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import expertaug

PACKAGES = (
    "torch",
    "torchdiffeq",
    "zuko",
    "numpy",
    "scipy",
    "pandas",
    "opencv-python-headless",
    "av",
    "snakemake",
    "mlflow",
)


def revision() -> str | None:
    """The git revision of this package's own checkout, with ``-dirty`` where it was changed; None outside of one."""
    here = Path(__file__).resolve()

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(["git", *arguments], cwd=here.parent, capture_output=True, text=True, timeout=5)
        except (OSError, subprocess.SubprocessError):
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    # A package installed below somebody else's checkout must not report that one's revision.
    if git("ls-files", "--error-unmatch", here.name) is None:
        return None
    return git("describe", "--always", "--dirty", "--abbrev=40", "--exclude=*")


def machine() -> dict[str, object]:
    """Processor and its cores, operating system, Python."""
    cores, model = 0, platform.processor()
    info = Path("/proc/cpuinfo")
    for line in info.read_text(encoding="utf-8").splitlines() if info.exists() else []:
        key, _, value = line.partition(":")
        cores += key.strip() == "processor"
        model = value.strip() if key.strip() == "model name" else model
    return {"processor": model, "cores": cores, "system": platform.system(), "python": platform.python_version()}


def versions() -> dict[str, str]:
    """Versions of this package and of those whose change could change a number."""
    installed = {"expertaug": expertaug.__version__}
    for name in PACKAGES:
        try:
            installed[name] = version(name)
        except PackageNotFoundError:
            continue
    return installed
