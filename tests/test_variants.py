"""Names of methods and of their augmented versions."""

import pytest

from expertaug import labels, plotting


@pytest.mark.parametrize(
    ("variant", "parts", "printed"),
    [
        ("node", ("node", None), "Node (small)"),
        ("node+", ("node", ""), "Node (small)+"),
        ("node+wide", ("node", "wide"), "Node (small)+ (wide)"),
    ],
)
def test_names_and_labels(variant, parts, printed):
    assert labels.split(variant) == parts and labels.base(variant) == "node"
    assert labels.label("Node (small)", variant) == printed
    assert labels.is_augmented(variant) == ("+" in variant)


def test_versions_are_in_the_order_of_their_methods():
    assert labels.ordered(["b", "a+", "c", "a"], ["a"]) == ["a", "a+", "b", "c"]
    assert labels.ordered(["a+x", "a", "a+"]) == ["a", "a+x", "a+"]
    assert labels.paired(["a", "b", "b+"]) == ["b", "b+"]
    assert labels.paired(["a", "b"]) == ["a", "b"]


def test_lines_of_augmented_versions_are_solid():
    assert plotting.dash("a+x") == plotting.dash("a+") == "-" != plotting.dash("a")
