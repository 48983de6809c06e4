"""What a card says of a group it says of some of its seeds; and cards that contradict themselves are refused."""

from __future__ import annotations

from expertaug.models.card import MisfitRecord


def test_a_record_of_some_seeds_has_no_variance_of_all():
    record = MisfitRecord.of(validation=[[1.0], [2.0]], expected=[[3.0], [4.0]], between=[5.0])
    assert record.of_seeds([1]) == MisfitRecord.of(validation=[[2.0]], expected=[[4.0]])
    assert record.of_seeds([0, 1]) == record
