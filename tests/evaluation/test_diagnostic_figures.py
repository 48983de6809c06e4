"""Figures of diagnostics and alarms: what is drawn, that nothing is cut off, and that bad input is told."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from whole_figures import assert_nothing_is_cut

from expertaug.errors import InputError
from expertaug.evaluation.diagnostic_figures import draw_alarm, draw_calibration
from expertaug.inference.diagnostics.alarm import assess, roc
from expertaug.inference.diagnostics.calibration import Calibration, interval_coverage

DRAWS, N = 99, 120


def ranks(seed: int, parameters: int, density: bool = True) -> Calibration:
    rng = np.random.default_rng(seed)
    marginal = rng.integers(0, DRAWS + 1, (N, parameters))
    marginal[:, 0] //= 2  # the first parameter's draws lie too high
    tarp, likelier = rng.integers(0, DRAWS + 1, (2, N))
    return Calibration(DRAWS, marginal, tarp, likelier if density else None)


def assessed(noise: float, n: int = 200):
    rng = np.random.default_rng(3)
    errors, validation = np.exp(2 * rng.normal(size=(2, n)))
    errors[: n // 2] *= 1e3
    scores, known = (np.log(e) + noise * np.random.default_rng(4).normal(size=n) for e in (errors, validation))
    return assess(scores, errors, known, validation)


class TestCalibration:
    def test_three_rows_and_a_column_for_each_kind_of_windows(self):
        kinds = {"own draws": ranks(0, 2), "validation": ranks(1, 2), "test": ranks(2, 2)}
        figure = draw_calibration(kinds, ["omega0", "alpha"], "pendulum, APHYNITY+ flow")
        assert len(figure.axes) == 9
        top, middle, low = np.reshape(figure.axes, (3, 3))[:, 1]
        assert top.get_title() == "validation\n(120 windows, 99 draws each)"
        words = [text.get_text() for text in top.texts]
        assert words[0] == r"$\omega_{0}$: p < 0.001" and words[1].startswith(r"$\alpha$: p = ")
        assert (len(top.lines), len(middle.lines), len(low.lines)) == (3, 4, 2)  # with the ideal
        x, share = top.lines[1].get_data()
        found = kinds["validation"].marginal[:, 0]
        place = np.searchsorted(x, 0.5)
        assert share[place] + x[place] == pytest.approx((found < 50).mean())
        x, share = middle.lines[1].get_data()
        expected = interval_coverage(found, DRAWS, [0.9]).share[0]
        assert share[np.searchsorted(x, 0.9 - 1e-9)] == pytest.approx(expected)
        assert_nothing_is_cut(figure)

    @pytest.mark.parametrize(("kinds", "parameters"), [(1, 1), (2, 4), (4, 3)])
    def test_of_other_sizes_nothing_is_cut(self, kinds, parameters):
        names = [f"omega{k}" for k in range(parameters)]
        given = {f"real recordings, part {k}": ranks(k, parameters, density=False) for k in range(kinds)}
        figure = draw_calibration(given, names)
        assert len(figure.axes[kinds].lines) == 1 + parameters  # no density, no line of it
        assert_nothing_is_cut(figure)

    def test_bad_input_is_told(self):
        with pytest.raises(InputError, match="kinds: none"):
            draw_calibration({}, ["a"])
        with pytest.raises(InputError, match="of 2 parameters; there are 1 names"):
            draw_calibration({"test": ranks(0, 2)}, ["a"])


class TestAlarm:
    def test_a_line_for_each_score_and_a_dot_at_its_threshold(self):
        scores = {"misfit of the window": assessed(0.5), "ensemble's spread": assessed(5.0)}
        figure = draw_alarm(scores, "pendulum, z_e shifted far")
        left, right = figure.axes
        for place, found in enumerate(scores.values()):
            x, y = left.lines[2 * place].get_data()
            np.testing.assert_allclose(np.stack([x, y]), roc(found.scores, found.failing))
            dot = left.lines[2 * place + 1].get_xydata()[0]
            assert tuple(dot) == pytest.approx((found.false_alarms, found.caught))
            assert np.hypot(*(np.stack([x, y]).T - dot).T).min() < 1e-12  # on the curve
            np.testing.assert_allclose(right.lines[place].get_ydata(), found.risk.risk)
        labels = [text.get_text() for text in figure.legends[0].get_texts()]
        area = scores["misfit of the window"].area
        assert labels[0].startswith(f"misfit of the window: AUROC {area.value:.3f} ({area.lower:.3f} to ")
        assert len({to_rgb(line.get_color()) for line in right.lines[:2]}) == 2
        assert_nothing_is_cut(figure)

    def test_where_no_window_fails_or_all_do(self):
        known = np.arange(1.0, 101.0)
        cured = draw_alarm({"misfit": assess([1, 2, 99, 3], [5, 6, 7, 8], known, known)})
        assert cured.legends[0].get_texts()[0].get_text() == "misfit: 25 % false alarms"
        lost = draw_alarm({"misfit": assess([1, 99, 98, 97], [500, 600, 700, 800], known, known)})
        assert lost.legends[0].get_texts()[0].get_text() == "misfit: 75 % caught"
        for figure in (cured, lost):
            assert len(figure.axes[0].lines) == 1
            assert_nothing_is_cut(figure)

    def test_bad_input_is_told(self):
        with pytest.raises(InputError, match="scores: none"):
            draw_alarm({})
        with pytest.raises(InputError, match="different errors"):
            draw_alarm({"a": assessed(1.0), "b": assessed(1.0, n=100)})
