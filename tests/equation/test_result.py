"""What was found is told with its errors, and written as text, LaTeX and Python."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.equation import result
from expertaug.equation.result import Coefficient, Found
from expertaug.equation.selection import Tried
from expertaug.equation.shooting import Formula
from expertaug.errors import InputError


@pytest.mark.parametrize(("criterion", "called"), [(-240.0, True), (-3.0, False)])
def test_what_few_validation_windows_do_not_tell_is_not_denied(criterion, called):
    formulas = Formula(), Formula((ea.Term("v", "v"),), (True,))
    fits = [SimpleNamespace(formula=f, criterion=c) for f, c in zip(formulas, (0.0, criterion), strict=True)]
    tried = tuple(Tried(fit, np.array([1e-5, 2e-5]), "direct", np.inf) for fit in fits)
    found = Found((), {}, (), tried, ("v: v",), np.nan, None)
    assert found.says.startswith("no term: the expert alone is as good")
    assert ("of 2 validation windows" in found.says) == ("call for v: v" in found.says) == called


def of(value, error, validation, validation_error, shared=True, text="omega"):
    spread = np.nan if shared else 0.1
    return Coefficient(ea.Term("omega", text), shared, value, error, spread, validation, validation_error)


def test_a_coefficient_that_moves_by_more_than_three_errors_is_no_law():
    still, moving = of(-0.30, 0.03, -0.15, 0.04), of(-0.30, 0.03, -0.14, 0.04)
    assert still.drift == pytest.approx(0.15 / 0.05) and moving.drift == pytest.approx(0.16 / 0.05)
    assert still.verdict == "law" and moving.verdict == "correction, not law"
    assert str(still) == "omega: omega: -0.300 ± 0.030 (law)"


def test_a_formula_is_written_as_text_latex_and_a_class_that_moves_so():
    system, found = ea.DampedPendulum(), [of(-0.3, 0.01, -0.3, 0.01), of(0.2, 0.1, 0.2, 0.1, False, "sin(theta)")]
    assert result.text_of(system, found) == "d omega/dt = expert - 0.300 omega + 0.20 sin(theta)"
    assert result.text_of(system, []) == "no term" and result.latex_of(system, []) == ""
    assert result.latex_of(system, found[:1]) == r"\dot{\omega} = F_{\mathrm{e},\omega} - 0.300 \, \omega"
    space: dict = {}
    exec(result.source_of(system, found, "Rubbed"), space)
    rubbed, y = space["Rubbed"](), torch.tensor([[0.4, -1.5]], dtype=torch.float64)
    assert [p.name for p in rubbed.expert_parameters] == ["omega0", "c0"]
    rate = rubbed.expert(torch.tensor(0.0), y, torch.tensor([[2.0, 0.7]], dtype=torch.float64))
    expected = [-1.5, -4 * np.sin(0.4) + 0.3 * 1.5 + 0.7 * np.sin(0.4)]
    np.testing.assert_allclose(rate[0], expected)


def test_what_has_no_name_or_no_text_is_not_written():
    class Inside(ea.DampedPendulum):
        pass

    with pytest.raises(InputError, match="give a name that a class can have"):
        result.source_of(ea.DampedPendulum(), [], "a b")
    with pytest.raises(InputError, match="is defined inside a function"):
        result.source_of(Inside(), [], "Rubbed")
