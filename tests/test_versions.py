"""Versions of methods: their names and labels."""

import pytest

from expertaug import plotting, versions
from expertaug.settings import Settings, read
from expertaug.versions import Version


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
    version = Version.parse(variant)
    assert (version.method, version.prior) == parts and versions.base(variant) == "node"
    assert version.label("Node (small)") == printed
    assert version.is_augmented == ("+" in variant)
    assert str(version) == variant


def test_versions_are_in_the_order_of_their_methods():
    assert versions.order_versions(["b", "a+", "c", "a"], ["a"]) == ["a", "a+", "b", "c"]
    assert versions.order_versions(["a+x", "a", "a+"]) == ["a", "a+x", "a+"]
    assert versions.choose_paired(["a", "b", "b+"]) == ["b", "b+"]
    assert versions.choose_paired(["a", "b"]) == ["a", "b"]


def test_lines_of_augmented_versions_are_solid():
    assert plotting.dash("a+x") == plotting.dash("a+") == "-" != plotting.dash("a")
    assert len({plotting.dash(version) for version in ("a", "a=", "a+", "a~refined")}) == 4


def test_which_file_a_version_uses_and_what_it_is():
    parsed = Version.parse
    assert str(parsed("a+~flow~refined").trained) == str(parsed("a+~flow").trained) == "a+~flow"
    assert str(parsed("a=~refined").trained) == "a=" and str(parsed("a").trained) == "a"
    assert [parsed(v).is_control for v in ("a", "a=", "a+", "a=~refined")] == [False, True, False, True]
    assert [parsed(v).is_flow for v in ("a+", "a+~flow", "a+~flow~refined")] == [False, True, True]
    assert [parsed(v).is_refined for v in ("a+", "a+~flow", "a+~flow~refined")] == [False, False, True]
    assert versions.order_versions(["a+~refined", "a+", "a=", "a~refined", "a"]) == [
        "a~refined",
        "a",
        "a=",
        "a+~refined",
        "a+",
    ]


def test_figures_compare_the_classical_estimator_first():
    names = ["least_squares", *(f"m{k}{v}" for k in range(versions.LINES) for v in ("", "~refined"))]
    assert "least_squares" not in versions.choose_compared(names)
    assert versions.choose_compared(names, "least_squares")[0] == "least_squares"
    assert len(versions.choose_compared(names, "least_squares")) == versions.LINES == 7
    assert len(versions.choose_compared(names, "least_squares", 6)) == 6


def test_settings_hold_versions_and_json_their_names():
    class Shown(Settings):
        method: Version

    shown = read(Shown, {"method": "a+~flow"}, "here")
    assert shown.method.is_flow and shown.model_dump(mode="json") == {"method": "a+~flow"}
