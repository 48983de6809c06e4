"""Terms: their values, what is refused, how they are written, and the interaction model that is made of them."""

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.errors import InputError
from expertaug.models.terms import Term, quantities

Y = torch.tensor([[0.3, -1.2], [2.0, 0.5]], dtype=torch.float64)
Z_E = torch.tensor([[2.0], [1.5]], dtype=torch.float64)
THETA, OMEGA = Y.unbind(-1)


@pytest.mark.parametrize(
    ("text", "value", "latex"),
    [
        ("omega", OMEGA, r"\omega"),
        ("abs(omega)*omega", OMEGA.abs() * OMEGA, r"\left|\omega\right| \, \omega"),
        ("tanh(omega/0.05)", torch.tanh(OMEGA / 0.05), r"\tanh\left(\frac{\omega}{0.05}\right)"),
        ("sin(2*theta) - pi", torch.sin(2 * THETA) - np.pi, r"\left(\sin\left(2 \, \theta\right) - \pi\right)"),
        ("omega0**2 * (theta - 1)", Z_E[:, 0] ** 2 * (THETA - 1), r"\omega_{0}^{2} \, \left(\theta - 1\right)"),
        ("-hypot(theta, 3)", -torch.hypot(THETA, torch.tensor(3.0)), r"-\mathrm{hypot}\left(\theta, 3\right)"),
        ("1", torch.ones(2, dtype=torch.float64), ""),
    ],
)
def test_a_text_is_what_it_says(text, value, latex):
    term = Term("omega", text).check(ea.DampedPendulum())
    torch.testing.assert_close(term.value(quantities(ea.DampedPendulum(), Y, Z_E)), value)
    assert term.latex == latex


@pytest.mark.parametrize(
    ("term", "says"),
    [
        ("omega = omega", "write it as 'rate: expression'"),
        ("omega: __import__('os')", "calls '__import__'"),
        ("omega: exp(", "no expression"),
        ("speed: omega", "'speed' has no rate; known: theta, omega"),
        ("omega: velocity", "names 'velocity'; known: theta, omega, omega0"),
    ],
)
def test_what_cannot_be_a_term_is_told(term, says):
    with pytest.raises(InputError, match=says):
        Term.of(term).check(ea.DampedPendulum())


def test_the_angles_of_a_system_are_what_is_in_rad():
    assert ea.DampedPendulum().angles == ("theta",)
    assert ea.RLC().angles == ()


def test_coefficients_are_numbers_or_z_a():
    terms = ["omega: omega", "theta: 1", "omega: sin(theta) / omega0"]
    model = ea.EquationInteraction(ea.DampedPendulum(), 2, terms=terms, coefficients=[None, 0.5, None])
    z_a = torch.tensor([[0.1, 3.0], [0.2, -1.0]], dtype=torch.float64)
    found = model(Y, model.context(z_a, Z_E))
    torch.testing.assert_close(found[:, 0], torch.full((2,), 0.5, dtype=torch.float64))
    torch.testing.assert_close(found[:, 1], z_a[:, 0] * OMEGA + z_a[:, 1] * torch.sin(THETA) / Z_E[:, 0])


def test_terms_see_known_inputs():
    model = ea.EquationInteraction(ea.DrivenPendulum(), 0, terms=["omega: torque * omega"], coefficients=[2.0])
    u = torch.tensor([[0.5], [3.0]], dtype=torch.float64)
    found = model(Y, model.context(Y.new_zeros(2, 0), Z_E), u)
    assert model.sees_inputs
    torch.testing.assert_close(found[:, 1], 2 * u[:, 0] * OMEGA)


def test_terms_of_fields_hold_at_every_cell():
    system = ea.ReactionDiffusion()
    names = [p.name for p in system.state]
    model = ea.EquationInteraction(system, 1, terms=[f"{names[1]}: {names[0]}**3"])
    y = torch.randn(2, *system.state_shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    z_a, z_e = y.new_tensor([[2.0], [3.0]]), y.new_ones(2, len(system.expert_parameters))
    found = model(y, model.context(z_a, z_e))
    torch.testing.assert_close(found[:, 1], z_a[:, :1, None] * y[:, 0] ** 3)
    assert not found[:, 0].any()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"terms": ["omega: omega"], "coefficients": [1.0, 2.0]}, "give 1, one for each term"),
        ({"terms": ["omega: omega", "omega: theta"]}, "2 of them are left to z_a; z_a has 1 components"),
    ],
)
def test_coefficients_that_do_not_fit(options, says):
    with pytest.raises(InputError, match=says):
        ea.EquationInteraction(ea.DampedPendulum(), 1, **options)


def test_a_model_with_an_encoder_may_have_one():
    recipe = ea.HybridModel(
        ea.DampedPendulum(),
        encoder={"kind": "window", "windows": {"theta": (0.0, 1.0)}, "layers": [4], "latent": 1},
        interaction={"kind": "equation", "terms": ["omega: omega"]},
    )
    assert recipe.build(np.arange(11) * 0.1, [0, 1]).interaction.terms == [Term("omega", "omega")]
