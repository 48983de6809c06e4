"""Forecasts as users get them: medians of seeds, and tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from small_pendulum import T

from expertaug.api.forecasts import Forecast
from expertaug.errors import InputError


def test_a_median_is_trusted_where_every_seed_is_and_contains_their_spread(fit, sets):
    refined = fit.refined(noise=0.01).forecast(sets["test"].y[:3, :11], T)
    verdicts = np.array([[True, True, False], [True, False, False]])
    median = replace(refined, trusted=verdicts, outside=~verdicts).median()
    assert median.trusted.tolist() == [True, False, False] and median.outside.tolist() == [False, True, True]
    std, z_e = (np.asarray(each["omega0"]) for each in (refined.z_e_std, refined.z_e))
    expected = np.sqrt((std**2).mean(0) + z_e.var(0, ddof=1))
    np.testing.assert_allclose(median.z_e_std["omega0"], expected, rtol=1e-5)
    assert set(median.table()["doubtful"]) <= {True, False} and len(median.table()) == 3 * len(T)


def test_a_seed_that_could_not_be_trained_has_no_part_in_a_median(fit, sets):
    each = replace(fit.refined(noise=0.01).forecast(sets["test"].y[:3, :11], T), failed=[0])
    median = each.median()
    np.testing.assert_array_equal(median.y, each.y[1])
    np.testing.assert_array_equal(median.z_e["omega0"], each.z_e["omega0"][1])
    np.testing.assert_allclose(median.z_e_std["omega0"], each.z_e_std["omega0"][1], rtol=1e-6)
    assert np.isnan(median.y_std).all() and len(median.table()) == 3 * len(T)
    assert replace(fit, stored=replace(fit.stored, card=fit.stored.card.but(failed=[0]))).forecast(
        sets["test"].y[:3, :11], T
    ).failed == [0]


def made():
    """Forecasts of three seeds for two windows at two times."""
    y = np.random.default_rng(0).standard_normal((3, 2, 2, 2))
    z_e, units = {"k": np.arange(6.0).reshape(3, 2)}, {"x": "m", "v": "m/s", "z_e k": "1/s"}
    return Forecast(np.array([0.0, 0.5]), y, z_e, units, [4, 5, 6])


def test_a_table_has_a_row_for_each_seed_window_and_time():
    table = made().table()
    assert list(table.columns) == ["seed", "sample", "t [s]", "x [m]", "v [m/s]", "z_e k [1/s]"]
    assert len(table) == 3 * 2 * 2
    row = table[(table["seed"] == 5) & (table["sample"] == 1) & (table["t [s]"] == 0.5)].iloc[0]
    assert (row["v [m/s]"], row["z_e k [1/s]"]) == (made().y[1, 1, 1, 1], 3.0)


def test_a_median_has_the_spread_of_the_seeds_and_is_its_own_median():
    median = made().median()
    np.testing.assert_array_equal(median.y, np.sort(made().y, 0)[1])
    np.testing.assert_allclose(median.y_std, made().y.std(0, ddof=1))
    assert median.z_e["k"].tolist() == [2.0, 3.0] and median.median() is median
    assert "seed" not in median.table() and "x std [m]" in median.table()


def test_fields_have_no_table():
    field = replace(made(), y=np.zeros((3, 2, 2, 2, 8)))
    with pytest.raises(InputError, match="a table holds states that are no fields"):
        field.table()
