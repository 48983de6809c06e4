"""Means of metrics over seeds, and of which sets."""

from __future__ import annotations

from expertaug.evaluation.summary import drawn_sets


def test_validation_is_drawn_only_where_no_other_set_is_of_its_domain():
    assert drawn_sets(iter(["test", "validation", "iid"])) == ["iid", "test"]
    assert drawn_sets(iter(["test", "validation"])) == ["validation", "test"]
