"""Names of methods and of their augmented versions."""

import pytest

from expertaug import labels, plotting


@pytest.mark.parametrize(
    ("variant", "parts", "printed"),
    [
        ("node", ("node", None), "Node (small)"),
        ("node+", ("node", ""), "Node (small)+"),
        ("node+wide", ("node", "wide"), "Node (small)+ (wide)"),
        ("node=", ("node", None), "Node (small) (control)"),
        ("node~refined", ("node", None), "Node (small) refined"),
        ("node+~flow~refined", ("node", ""), "Node (small)+ flow, refined"),
        ("node+wide~flow", ("node", "wide"), "Node (small)+ (wide) flow"),
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
    assert len({plotting.dash(version) for version in ("a", "a=", "a+", "a~refined")}) == 4


def test_which_file_a_version_uses_and_what_it_is():
    assert labels.trained("a+~flow~refined") == labels.trained("a+~flow") == "a+~flow"
    assert labels.trained("a=~refined") == "a=" and labels.trained("a") == "a"
    assert [labels.is_control(v) for v in ("a", "a=", "a+", "a=~refined")] == [False, True, False, True]
    assert [labels.is_flow(v) for v in ("a+", "a+~flow", "a+~flow~refined")] == [False, True, True]
    assert [labels.is_refined(v) for v in ("a+", "a+~flow", "a+~flow~refined")] == [False, False, True]
    assert labels.ordered(["a+~refined", "a+", "a=", "a~refined", "a"]) == ["a~refined", "a", "a=", "a+~refined", "a+"]


def test_figures_compare_the_classical_estimator_first():
    versions = ["least_squares", *(f"m{k}{v}" for k in range(labels.LINES) for v in ("", "~refined"))]
    assert "least_squares" not in labels.compared(versions)
    assert labels.compared(versions, "least_squares")[0] == "least_squares"
    assert len(labels.compared(versions, "least_squares")) == labels.LINES
