"""An F_a that is an equation, against the same sum by hand."""

from __future__ import annotations

import pytest
import torch

from expertaug.errors import InputError
from expertaug.models.interactions.equation import EquationInteraction
from expertaug.systems.pendulum import DampedPendulum


def test_each_term_is_added_to_its_rate_with_a_number_or_the_next_component_of_z_a():
    terms = ("omega: abs(omega) * omega", "omega: omega0 * theta", "theta: omega")
    f_a = EquationInteraction(DampedPendulum(), 2, terms=terms, coefficients=(None, -0.5, None))
    y, z_a, z_e = torch.randn(4, 2), torch.randn(4, 2), torch.rand(4, 1) + 1
    theta, omega = y.unbind(-1)
    expected = z_a[:, 0] * omega.abs() * omega - 0.5 * z_e[:, 0] * theta
    torch.testing.assert_close(f_a(y, f_a.context(z_a, z_e)), torch.stack((z_a[:, 1] * omega, expected), -1))


def test_a_function_stands_for_a_term_that_is_no_arithmetic():
    functions = {"omega: jerk": lambda values: values["omega"].sign()}
    f_a = EquationInteraction(DampedPendulum(), 1, terms=("omega: jerk",), functions=functions)
    y, z_a, z_e = torch.randn(4, 2), torch.rand(4, 1), torch.ones(4, 1)
    torch.testing.assert_close(f_a(y, f_a.context(z_a, z_e))[:, 1], z_a[:, 0] * y[:, 1].sign())


def test_without_terms_nothing_is_added_and_z_a_has_as_many_components_as_there_are_free_coefficients():
    y = torch.randn(4, 2)
    f_a = EquationInteraction(DampedPendulum(), 0, terms=())
    assert torch.equal(f_a(y, f_a.context(y[:, :0], y[:, :1])), torch.zeros_like(y))
    with pytest.raises(InputError, match="1 of them are left to z_a; z_a has 2 components"):
        EquationInteraction(DampedPendulum(), 2, terms=("omega: omega",))
