"""The README's tables hold the published numbers."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_tables_are_as_published(tmp_path):
    for name in ("benchmarks", "results/published"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).symlink_to(ROOT / name)
    readme = tmp_path / "README.md"
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(re.findall("<!-- table: ", text)) == 5

    def run(*options: str) -> int:
        script = tmp_path / "benchmarks" / "readme_tables.py"
        return subprocess.run([sys.executable, script, "--root", tmp_path, *options], check=False).returncode

    readme.write_text(text, encoding="utf-8")
    assert run("--check") == 0, "python benchmarks/readme_tables.py"
    wrong = re.sub(r"(\| pendulum \| validation \(IID\) \| −)\d", r"\g<1>0", text, count=1)
    readme.write_text(wrong, encoding="utf-8")
    assert wrong != text and run("--check") == 1
    assert run() == 0 and readme.read_text(encoding="utf-8") == text
