"""Settings of the search for an equation: none needs to be given, and each mistake is one line."""

from __future__ import annotations

import pytest

from expertaug.equation.settings import EquationSettings
from expertaug.errors import InputError


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({"most_term": 3}, "equation.most_term: unknown key; did you mean 'most_terms'?"),
        ({"samples": 0}, "equation.samples: found 0; give 1 or more"),
        ({"most_terms": 2.5}, "equation.most_terms: found 2.5; give a whole number"),
        ({"extra": "omega: omega"}, "equation.extra: found 'omega: omega'; give a list"),
        ({"components": ["omega", 1]}, "equation.components[1]: found 1; give a text"),
        ({"kinematics": "yes"}, "equation.kinematics: found 'yes'; give true or false"),
    ],
)
def test_a_mistake_is_one_line(given, expected):
    with pytest.raises(InputError) as caught:
        EquationSettings.from_mapping(given)
    assert str(caught.value).startswith(expected)


def test_lists_of_terms_are_each_searchs_own():
    one = EquationSettings()
    assert one.extra == one.by_hand == [] and one.extra is not EquationSettings().extra
    assert EquationSettings.from_mapping({"components": None, "extra": ["x: x"]}).dump() == {
        "components": None,
        "extra": ["x: x"],
    }
