"""The tables of README and docs hold the published numbers."""

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
    pages = {page.relative_to(ROOT): page.read_text(encoding="utf-8") for page in ROOT.glob("docs/*.md")}
    pages |= {Path("README.md"): (ROOT / "README.md").read_text(encoding="utf-8")}
    assert sum(len(re.findall("<!-- table: ", text)) for text in pages.values()) == 17
    (tmp_path / "docs").mkdir()

    def write(texts: dict[Path, str]) -> None:
        for page, text in texts.items():
            (tmp_path / page).write_text(text, encoding="utf-8")

    def run(*options: str) -> int:
        script = tmp_path / "benchmarks" / "readme_tables.py"
        return subprocess.run([sys.executable, script, "--root", tmp_path, *options], check=False).returncode

    write(pages)
    assert run("--check") == 0, "python benchmarks/readme_tables.py"
    rows = {Path("README.md"): "APHYNITY+", Path("docs/results.md"): "pendulum | IID test"}
    for page, row in rows.items():
        wrong = re.sub(rf"(\| {re.escape(row)} \| −)\d", r"\g<1>0", pages[page], count=1)
        assert wrong != pages[page]
        write(pages | {page: wrong})
        assert run("--check") == 1
        assert run() == 0
        assert {name: (tmp_path / name).read_text(encoding="utf-8") for name in pages} == pages
