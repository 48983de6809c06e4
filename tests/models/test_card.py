"""What a card says of a group it says of some of its seeds; and cards that contradict themselves are refused."""

from __future__ import annotations

import pytest

from cards import card
from expertaug.errors import InputError
from expertaug.models.card import MisfitRecord


def test_a_record_of_some_seeds_has_no_variance_of_all():
    record = MisfitRecord.of(validation=[[1.0], [2.0]], expected=[[3.0], [4.0]], between=[5.0])
    assert record.of_seeds([1]) == MisfitRecord.of(validation=[[2.0]], expected=[[4.0]])
    assert record.of_seeds([0, 1]) == record


TIMES = {"t": [0.0, 0.1, 0.2], "observed": 2}


def test_a_card_of_some_seeds_has_their_values_and_all_else_as_it_was():
    carried = {"multiplier": [1.0, 2.0, 3.0], "steps": 4}
    support = {"least_z_e": [[0.1], [0.2], [0.3]], "most_z_e": [[1.1], [1.2], [1.3]]}
    whole = card(TIMES, seeds=[3, 4, 7], best_epoch=[5, 6, 9], carried=carried, support=support)
    some = whole.of_seeds([2, 0])
    assert (some.seeds, some.best_epoch, some.t) == ([7, 3], [9, 5], whole.t)
    assert some.carried == {"multiplier": [3.0, 1.0], "steps": 4}
    assert some.support.least_z_e == [[0.3], [0.1]] and some.support.most_z_e == [[1.3], [1.1]]
    assert whole.seeds == [3, 4, 7], "the whole stays as it is"


def test_none_takes_a_key_away_and_other_values_take_its_place():
    whole = card(TIMES, wall_s=3.0)
    found = whole.but(wall_s=None, observed=3)
    assert "wall_s" not in found.to_json() and found.observed == 3 and (whole.wall_s, whole.observed) == (3.0, 2)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"t": [0.0, 0.1, 0.1]}, "t: does not increase"),
        ({"observed": 4}, "observed: found 4; there are 3 times"),
        ({"system": {}}, "system: names no system"),
        ({"model": {"encoder": {"hidden": 2}}}, "encoder.*names no kind"),
    ],
)
def test_a_card_that_contradicts_itself_is_refused_in_a_line(changed, says):
    with pytest.raises(InputError, match=says) as caught:
        card(TIMES, **changed)
    assert "\n" not in str(caught.value)
