"""Tables, whatever stands in them."""

from __future__ import annotations

import re

import pytest

from expertaug.evaluation.table import Table


@pytest.mark.parametrize("name", ["a|b", "<script>x</script>", "a\nb", "x^2 ~ y", "\\input{x}", "a < b"])
def test_what_a_name_holds_stays_in_its_cell(name):
    of_name = Table(["method", "n"], [("", [[name, "1"]])])
    line = next(one for one in of_name.markdown().splitlines() if "1 |" in one)
    assert not re.search(r"(?<!\\)<[A-Za-z/!]", line) and len(re.findall(r"(?<!\\)\|", line)) == 3
    line = next(one for one in of_name.tex().splitlines() if "& 1" in one)
    assert not re.search(r"[\^~]", line) and r"\input" not in line
