"""What pages say: numbers that published tables have, in words that a reader needs, and not too many of them."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from docs_pages import OWN, ROOT, blocks, name_of, words
from docs_pages import PAGES as TESTED

NUMBER = r"-?\d*\.?\d+"
INTERVAL = re.compile(rf"({NUMBER}) \[({NUMBER}), ({NUMBER})\]")
PAGES = ["README.md", *(str(page.relative_to(ROOT)) for page in sorted((ROOT / "docs").glob("*.md")))]

# By users; records of trials are not.
READ = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", ROOT / "benchmarks" / "README.md"]
READ += [ROOT / "config" / "README.md", *OWN, ROOT / "docs" / "index.md", *sorted(ROOT.glob("docs/notebooks/*.ipynb"))]
# A revision of the repository: seven hexadecimal digits or more, with a letter and a digit among them.
HASH = re.compile(r"\b(?=[0-9a-f]*[0-9])(?=[0-9a-f]*[a-f])[0-9a-f]{7,40}\b")
DIALECT = re.compile(
    r"told apart|beside (?:other work|little else|a training)|of then\b|earlier run|isolated|\baudit|"
    r"of today|today's|in the run before|not yet here|a run at\b|on that host|an earlier host",
    re.I,
)
BARE_DECIMAL = re.compile(r"(?<![\w.)\]*/])[−-]?\.\d")


def intervals(text: str) -> set[tuple[float, ...]]:
    """Mean and ends, also of those that are broken over two lines."""
    plain = re.sub(r"\s+", " ", text.replace("−", "-"))
    return {tuple(map(float, found.groups())) for found in INTERVAL.finditer(plain)}


@pytest.fixture(scope="module")
def published() -> set[tuple[float, ...]]:
    tables = (ROOT / "results/published").glob("*/tables/*.md")
    return set.union(*(intervals(table.read_text(encoding="utf-8")) for table in tables))


@pytest.mark.parametrize("page", PAGES)
def test_intervals_are_those_of_a_published_table(page, published):
    """A loss is cited as a positive number where the table has a negative gain."""
    cited = intervals((ROOT / page).read_text(encoding="utf-8"))
    turned = {(-mean, -high, -low) for mean, low, high in published}
    assert not cited - published - turned, "no table in results/published has these: was a run published since?"


def test_a_number_that_no_table_has_is_found(published):
    assert intervals("gains 5.69 [−.96,\n12.05] nats") == {(5.69, -0.96, 12.05)}
    assert not intervals("gains 5.69 [−.96, 12.05] nats") & published


def said(page: Path) -> str:
    """What a page says, tables too, without code; of a notebook its cells of text."""
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".ipynb":
        cells = [cell for cell in json.loads(text)["cells"] if cell["cell_type"] == "markdown"]
        text = "\n\n".join("".join(cell["source"]) for cell in cells)
    return re.sub(r"`[^`]*`", "", re.sub(r"^```.*?^```$|<!--.*?-->", "", text, flags=re.M | re.S))


@pytest.mark.parametrize("page", READ, ids=name_of)
def test_pages_say_what_holds_now(page):
    """No revisions and none of the words of those who wrote them; code and its output are left out."""
    text = said(page)
    assert HASH.findall(text) == [] and DIALECT.findall(re.sub(r"\s+", " ", text)) == []


@pytest.mark.parametrize("page", READ, ids=name_of)
def test_decimals_have_one_style(page):
    """A digit before the point, in tables as well."""
    text = said(page)
    assert [text[max(m.start() - 20, 0) : m.end() + 9] for m in BARE_DECIMAL.finditer(text)] == []


def test_what_a_page_may_not_say_is_found():
    assert HASH.findall("at 2254aed and e1dfb20, 1234567 samples defaced") == ["2254aed", "e1dfb20"]
    assert (
        DIALECT.search("not told apart") and DIALECT.search("with three seeds of then") and not DIALECT.search("often")
    )
    assert BARE_DECIMAL.search("off by .08 s") and not BARE_DECIMAL.search("0.08 s, model.1, e.g. this")


@pytest.mark.parametrize("page", [page for page in TESTED if page != ROOT / "config" / "README.md"], ids=name_of)
def test_code_fits_the_page(page):
    """Lines that are copied and pasted; config/README.md is made from the models."""
    lines = [
        (f"{block.page}:{block.line + k}", line)
        for block in blocks(page)
        for k, line in enumerate(block.text.splitlines())
    ]
    assert [where for where, line in lines if len(line) > 100] == []


def test_the_documentation_is_short():
    """Text alone: code, tables, config/README.md, docstrings and records of trials are not counted."""
    assert sum(map(words, (*OWN, ROOT / "docs" / "index.md"))) <= 15_000
    assert words(ROOT / "docs" / "what_has_been_shown.md") <= 600
