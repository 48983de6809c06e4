"""Names of methods and of their augmented versions."""

import pytest

from expertaug import labels


@pytest.mark.parametrize(
    ("variant", "parts", "printed"),
    [
        ("node", ("node", None), "Node (small)"),
        ("node+", ("node", ""), "Node (small)+"),
        ("node+wide", ("node", "wide"), "Node (small)+ (wide)"),
    ],
)
def test_names_and_labels(variant, parts, printed):
    assert labels.split(variant) == parts
    assert labels.label("Node (small)", variant) == printed
    assert labels.is_augmented(printed) == ("+" in variant)


def test_base_of_a_label_keeps_its_brackets():
    assert labels.base_label("Node+") == "Node"
    assert labels.base_label("Node+ (paper)") == "Node (paper)"
    assert labels.base_label("A+B (x)") == "A+B (x)"
