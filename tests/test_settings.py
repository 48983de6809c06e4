"""Typed settings: one line for each mistake, and what was left out is not written."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, ClassVar, Literal

import pytest
from pydantic import ValidationError
from pydantic_core import PydanticCustomError

from expertaug.errors import InputError, InputErrors, lines
from expertaug.settings import (
    LEFT_OUT,
    ByName,
    Count,
    Noise,
    Positive,
    Range,
    Seeds,
    Settings,
    agreement,
    check,
    disagree,
    given_ranges,
    key,
)


class Inner(Settings):
    width: Count = key(3, "how wide")


class Block(Settings):
    WHERE: ClassVar[str] = "block"
    RENAMED: ClassVar = {"long": "it is called size now"}

    size: Positive = key(..., "how large", "m")
    inner: Inner = key(LEFT_OUT, "more of it")
    ends: Range = key((0.0, 1.0), "from where to where")
    noise: Noise = key(0.0, "of the data")
    seeds: Seeds = key(LEFT_OUT, "of trainings")
    mode: Literal["slow", "fast"] = key("slow", "how")
    part: Annotated[str, ByName(lambda: ["wheel", "axle"])] = key("wheel", "which")


class Pair(Settings):
    low: float = key(0.0, "the lower")
    high: float = key(1.0, "the higher")

    @agreement
    def _in_order(self) -> Iterator[PydanticCustomError]:
        if self.low > self.high:
            yield disagree("is above high", "give less", "low")
            yield disagree("is below low", "give more", "high")


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, "block.size: missing; give size (how large)"),
        ({"size": True}, "block.size: found true; give a number"),
        ({"size": float("nan")}, "block.size: found .nan; give a number"),
        ({"size": "1e3"}, "block.size: found '1e3', which YAML takes for a text; write 1.0e+3"),
        ({"size": 0.0}, "block.size: found 0.0; give more than 0"),
        ({"size": 1.0, "long": 2}, "block.long: unknown key; it is called size now"),
        ({"size": 1.0, "sise": 2}, "block.sise: unknown key; did you mean 'size'?"),
        ({"size": 1.0, "inner": {"width": 1.5}}, "block.inner.width: found 1.5; give a whole number"),
        ({"size": 1.0, "inner": 3}, "block.inner: found 3; give a mapping of keys"),
        ({"size": 1.0, "ends": [2.0, 1.0]}, "block.ends: found [2.0, 1.0]; min must not exceed max"),
        ({"size": 1.0, "noise": "estimatd"}, "block.noise: found 'estimatd'; did you mean 'estimated'?"),
        ({"size": 1.0, "noise": {"x": -1}}, "block.noise.x: found -1; give 0 or more"),
        ({"size": 1.0, "seeds": [3, 1, 3]}, "block.seeds[2]: 3 is there twice; give each once"),
        ({"size": 1.0, "mode": "fest"}, "block.mode: found 'fest'; did you mean 'fast'?"),
        ({"size": 1.0, "part": "weel"}, "block.part: found 'weel'; did you mean 'wheel'?"),
        ([1], "block: found [1]; give a mapping of keys"),
    ],
)
def test_a_mistake_is_one_line_that_says_what_would_be_right(given, expected):
    with pytest.raises(InputError) as caught:
        Block.from_mapping(given)
    (line,) = lines(caught.value)
    assert line.startswith(expected)


def test_every_mistake_is_told_and_those_of_parts_wait_for_the_whole():
    wrong = {"low": 2.0, "high": 1.0}
    assert [str(error) for error in check(Pair, wrong, "pair")] == [
        "pair.low: is above high; give less",
        "pair.high: is below low; give more",
    ]
    assert check(Pair, wrong, "pair", whole=False) == []
    with pytest.raises(InputErrors) as caught:
        Block.of(size=0.0, mode="fest", other=1)
    assert len(lines(caught.value)) == 3


def test_what_is_left_out_is_not_written_and_what_is_given_is_read_again():
    few, all_of_it = Block.of(size=2.0), Block.of(size=2.0, inner={"width": 4}, ends=[1, 2], part="own.module:Class")
    defaults = {"ends": [0.0, 1.0], "noise": 0.0, "mode": "slow", "part": "wheel"}
    assert few.to_json() == {"size": 2.0} | defaults and few.dump() == {"size": 2.0}
    assert few.inner is None and all_of_it.inner.width == 4
    for one in (few, all_of_it):
        assert Block.from_mapping(one.to_json()) == one
    assert Block.completed({"size": 2.0}).dump() == {"size": 2.0} | defaults
    with pytest.raises(ValidationError):
        few.size = 3.0


def test_ranges_that_are_to_be_found_are_asked_for():
    assert given_ranges({"k": (1.0, 2.0)}) == {"k": (1.0, 2.0)}
    with pytest.raises(InputError, match="--prior: missing"):
        given_ranges("own")
