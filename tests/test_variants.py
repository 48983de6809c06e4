"""Names of methods and of their augmented versions."""

import pytest

from expertaug import variants


@pytest.mark.parametrize(
    ("variant", "parts", "printed"),
    [
        ("node", ("node", None), "Node (small)"),
        ("node+", ("node", ""), "Node (small)+"),
        ("node+wide", ("node", "wide"), "Node (small)+ (wide)"),
    ],
)
def test_names_and_labels(variant, parts, printed):
    assert variants.split(variant) == parts
    assert variants.label("Node (small)", variant) == printed
    assert variants.is_augmented(printed) == ("+" in variant)


def test_base_of_a_label_keeps_its_brackets():
    assert variants.base_label("Node+") == "Node"
    assert variants.base_label("Node+ (paper)") == "Node (paper)"
    assert variants.base_label("A+B (x)") == "A+B (x)"
