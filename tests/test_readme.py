"""The tables of README and docs hold the published numbers, and the way from a CSV to a forecast can be gone."""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path

import pandas as pd
import pytest

from docs_pages import blocks, checkout, run

ROOT = Path(__file__).parents[1]


def test_tables_are_as_published(tmp_path, monkeypatch):
    (tmp_path / "results").mkdir()
    (tmp_path / "results" / "published").symlink_to(ROOT / "results" / "published")
    pages = {page.relative_to(ROOT): page.read_text(encoding="utf-8") for page in ROOT.glob("docs/*.md")}
    pages |= {Path("README.md"): (ROOT / "README.md").read_text(encoding="utf-8")}
    assert (
        sum(
            len(re.findall("<!-- (?:table|seeds|beside the paper|value|count|alarm): ", text))
            for text in pages.values()
        )
        == 65
    )
    (tmp_path / "docs").mkdir()

    def write(texts: dict[Path, str]) -> None:
        for page, text in texts.items():
            (tmp_path / page).write_text(text, encoding="utf-8")

    main = runpy.run_path(str(ROOT / "benchmarks" / "readme_tables.py"))["main"]

    def fill(*options: str) -> int:
        monkeypatch.setattr("sys.argv", ["readme_tables.py", "--root", str(tmp_path), *options])
        return main()

    write(pages)
    assert fill("--check") == 0, "python benchmarks/readme_tables.py"
    rows = {Path("README.md"): "APHYNITY+ |  ", Path("docs/results.md"): "pendulum | IID test"}
    wrong = {
        page: re.sub(rf"(\| {re.escape(row)} ?\| −)\d", r"\g<1>0", pages[page], count=1) for page, row in rows.items()
    }
    for page, text in wrong.items():
        assert text != pages[page]
        write(pages | {page: text})
        assert fill("--check") == 1
    write(wrong)
    assert fill() == 0
    assert {name: (tmp_path / name).read_text(encoding="utf-8") for name in pages} == pages


@pytest.mark.slow
def test_a_csv_becomes_a_forecast_by_the_commands_of_the_first_page(tmp_path):
    """As written, but for a training of few steps and fewer forecasts to score."""
    (block,) = (block for block in blocks(ROOT / "README.md") if block.in_order)
    folder = checkout(tmp_path / "project", "README.md")
    said = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    assert "`expertaug example-table > swings.csv`" in said
    (folder / "swings.csv").write_text(run(folder, "-m", "expertaug.cli", "example-table").stdout, encoding="utf-8")
    for line in block.text.replace("\\\n", " ").splitlines():
        program, *arguments = shlex.split(line, comments=True)
        output = folder / arguments.pop() if ">" in arguments else None
        arguments = [argument for argument in arguments if argument != ">"]
        done = run(folder, "-m", "expertaug.cli" if program == "expertaug" else program, *arguments, timeout=900)
        assert done.returncode == 0, done.stdout + done.stderr
        if output:
            short = "overrides: {alternating: {alternation: {steps: 4, batch_size: 20, validate_every: 2}}}"
            proposed = re.sub(r"methods: .*", "methods: [alternating]", re.sub(r"overrides: .*", short, done.stdout))
            proposed = re.sub(r"evaluation: {", "evaluation: {train_samples: 10, drawn_samples: 10, ", proposed)
            proposed = re.sub(r"\n    (augmented|controls|refined): \[.*", "", proposed) + "    validity: null\n"
            output.write_text(proposed, encoding="utf-8")
    forecast = pd.read_csv(folder / "forecast.csv")
    assert set(forecast["sample"]) == {f"swings/{trial}" for trial in range(20)}
    told = done.stdout + done.stderr
    assert len(re.findall(r"omega0 = \S+ ± .* (?:not )?to be trusted", told)) == 20, told
