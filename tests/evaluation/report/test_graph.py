"""The rule graph of the report: what reads stands below what makes, and no two boxes touch."""

from __future__ import annotations

import re
from itertools import combinations

import pytest

from expertaug.evaluation.report.graph import HIGH, WIDEST, drawing

LINE = [("simulate", "train"), ("train", "augment"), ("augment", "finetune"), ("finetune", "evaluate")]
SHORTER = [("simulate", "finetune"), ("train", "finetune"), ("train", "evaluate"), ("simulate", "evaluate")]
LEAVES = [("evaluate", f"a_rule_of_a_rather_long_name_{k}") for k in range(12)]


@pytest.fixture(scope="module")
def drawn():
    return drawing([*LINE, *SHORTER, *LEAVES, ("train", "validity"), ("tracking", "train")])


def ends(drawn) -> set[tuple[str, str]]:
    """From which box to which each path goes."""
    found = set()
    for path in drawn.paths:
        numbers = [float(one) for one in re.findall(r"-?\d+\.\d", path)]
        (x, y), (to_x, to_y) = numbers[:2], numbers[-2:]
        above = next(b.name for b in drawn.boxes if abs(b.x - x) < 0.1 and abs(b.y + HIGH / 2 - y) < 0.1)
        below = next(b.name for b in drawn.boxes if abs(b.x - to_x) < 0.1 and abs(b.y - HIGH / 2 - to_y) < 0.1)
        found.add((above, below))
    return found


def test_every_arrow_goes_down_and_those_that_follow_from_others_are_left_out(drawn):
    y = {box.name: box.y for box in drawn.boxes}
    assert all(y[above] < y[below] for above, below in [*LINE, *SHORTER, *LEAVES])
    assert ends(drawn) == {*LINE, *LEAVES, ("train", "validity"), ("tracking", "train")}


def test_boxes_lie_apart_and_inside_and_wide_layers_are_folded(drawn):
    for a, b in combinations(drawn.boxes, 2):
        assert abs(a.y - b.y) >= 2 * HIGH or abs(a.x - b.x) > (a.width + b.width) / 2
    for box in drawn.boxes:
        assert box.width / 2 < box.x < drawn.width - box.width / 2 and HIGH / 2 < box.y < drawn.height - HIGH / 2
    assert drawn.width < WIDEST + 100


def test_the_order_of_the_arrows_changes_nothing(drawn):
    assert drawing(reversed([*LINE, *SHORTER, *LEAVES, ("train", "validity"), ("tracking", "train")])) == drawn


def test_without_rules_there_is_nothing_to_draw():
    assert drawing([]).boxes == []
