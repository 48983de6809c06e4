"""The library of candidates has what a scientist would try in each rate."""

from __future__ import annotations

import expertaug as ea
from expertaug.equation.library import library, rates_of
from rubbed_swings import swings


def test_kinematic_rates_are_left_alone_unless_asked_for():
    assert rates_of(ea.DampedPendulum(), False) == ["omega"]
    assert rates_of(ea.DampedPendulum(), True) == ["theta", "omega"]
    assert rates_of(ea.RLC(), False) == ["U", "I"]
    assert rates_of(ea.DampedWave(cells=8), False) == ["w_t"]
    assert rates_of(ea.DrivenPendulum(), False) == ["omega"]


def test_the_library_has_what_the_system_calls_for():
    texts = [term.text for term in library(ea.DampedPendulum(), swings("train"), ["omega"])]
    assert {"1", "omega", "sin(theta)", "abs(omega)*omega", "cos(theta)*omega"} <= set(texts)
    assert any(text.startswith("tanh(omega/") for text in texts)
    assert not any("abs(theta)" in text for text in texts)
    assert len(set(texts)) == len(texts)
