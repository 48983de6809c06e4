"""Sentences that cite a mean with its interval cite one that stands in a published table."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NUMBER = r"-?\d*\.?\d+"
INTERVAL = re.compile(rf"({NUMBER}) \[({NUMBER}), ({NUMBER})\]")
PAGES = ["README.md", *(str(page.relative_to(ROOT)) for page in sorted((ROOT / "docs").glob("*.md")))]


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
