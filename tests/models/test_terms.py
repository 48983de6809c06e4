"""Terms of fields, what they have in common, and numbers as they are written."""

from __future__ import annotations

import math

import pytest
import torch

from expertaug.models.terms import Term, latex_name, quantities, round_to_error
from expertaug.systems.reaction_diffusion import ReactionDiffusion


def test_parameters_are_those_of_every_cell_of_a_field():
    system, y, z_e = ReactionDiffusion(), torch.rand(4, 2, 32, 32), torch.rand(4, 2)
    u, a = system.state[0].name, system.expert_parameters[0].name
    values = quantities(system, y, z_e)
    found = Term(u, f"{a} * {u}**3").check(system).value(values)
    torch.testing.assert_close(found, z_e[:, 0].view(4, 1, 1) * y[:, 0] ** 3)
    assert set(quantities(system, y, z_e, chosen=[a])) == {u, a}, "and the first component in any case"


def test_a_call_that_terms_have_in_common_is_computed_once():
    values = {"x": torch.tensor([-2.0, 3.0])}
    assert Term("x", "abs(x) * x").value(values).tolist() == [-4.0, 9.0]
    values["abs(x)"] = torch.tensor([10.0, 10.0])
    assert Term("x", "1 + abs(x)").value(values).tolist() == [11.0, 11.0]


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [(1.23456, 0.031, "1.235"), (1234.6, 21.0, "1235"), (0.123456, math.nan, "0.1235"), (2.0, 0.0, "2")],
)
def test_a_number_is_written_to_two_digits_of_its_error_or_four_of_its_own(value, error, text):
    assert round_to_error(value, error) == text and round_to_error(math.inf, error) == "nan"


def test_names_are_typeset_as_symbols_with_what_follows_as_an_index():
    names = ("omega0", "k", "spring_rate", "theta_1_x")
    assert [latex_name(name) for name in names] == [r"\omega_{0}", "k", r"\mathrm{spring}_{rate}", r"\theta_{1,x}"]
