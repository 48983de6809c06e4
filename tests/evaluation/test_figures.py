"""Figures: what is drawn, that nothing is cut off, and that bad input is told."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from fake_runs import (
    loaded,
    rows_of,
    tables_of,
    write_forecasts,
    write_logs,
    write_metrics,
)
from matplotlib.image import imread

from expertaug import plotting
from expertaug.errors import InputError
from expertaug.evaluation import dots, parameters, traces
from expertaug.evaluation.forecasts import Forecasts
from expertaug.evaluation.settings import PlotJob, Titles
from expertaug.evaluation.traces import View
from expertaug.hues import HUES, assign_hues
from expertaug.tracking.log import read_log


def test_an_end_that_rounding_puts_beyond_its_mean_is_drawn(drawn, tmp_path):
    """Of a parameter that all windows share each sample has the same error."""
    lengths = plotting.whiskers([14.457905, 1.0], [14.457905 + 2e-15, np.nan], [14.457905, 2.0])
    assert (lengths >= 0).all() and lengths[:, 1].tolist() == [0.0, 1.0]
    (axis,) = plotting.new_figure(2).subplots(1, 1, squeeze=False)[0]
    axis.errorbar([14.457905, 1.0], [0, 1], xerr=lengths)


def test_a_method_has_one_colour_in_figures_of_different_methods():
    hues = {"mean": 0, "expert_only": 1, "hybrid": 2}
    assert plotting.colours(["hybrid"], hues)["hybrid"] == plotting.colours(["mean", "hybrid"], hues)["hybrid"]
    pair = plotting.colours(["hybrid", "hybrid+", "hybrid+wide"], hues)
    assert sum(pair["hybrid"]) > sum(pair["hybrid+"]) + 0.5 and pair["hybrid+wide"] == pair["hybrid+"]


def test_methods_drawn_together_have_hues_of_their_own_as_long_as_there_are_as_many():
    count = len(HUES)
    methods = [f"m{k}" for k in range(2 * count)]
    found = assign_hues([*([name] for name in methods), methods[count - 1 : 2 * count - 1], [methods[0], methods[-1]]])
    assert [found[name] for name in methods[:count]] == list(range(count))
    assert len({found[name] for name in methods[count - 1 : 2 * count - 1]}) == count
    assert found[methods[0]] != found[methods[-1]]
    assert set(assign_hues([methods]).values()) == set(range(count)), "more than there are hues: each is taken"
    assert plotting.colours(["a", "b"], {"a": 3})["a"] == plotting.colours(["a"], {"a": 3})["a"]
    assert len(set(plotting.colours(["a", "b", "c"], {"a": 1}).values())) == 3


def test_words_are_printed_once():
    once = plotting.text("APHYNITY (F_a of known form), z_e")
    assert once == "APHYNITY ($F_a$ of known form), $z_e$" == plotting.text(once)


def test_symbols():
    assert plotting.symbol("omega0") == r"$\omega_{0}$"
    assert plotting.symbol("theta") == r"$\theta$"
    assert plotting.symbol("L") == "$L$"
    assert plotting.symbol("spring_rate") == "spring rate"
    assert plotting.quantity("k", "") == "$k$ [1]"


def test_names_with_underscores_are_made_readable():
    assert plotting.text("APHYNITY, F_a sees z_e+") == "APHYNITY, $F_a$ sees $z_e$+"
    assert Titles().of_set("both_small") == "both small" and Titles().of_set("z_a_small") == "z_a small"
    assert Titles(set_titles={"z_a_small": "near"}).of_set("z_a_small") == "near"
    assert Titles().of_experiment("double_swing") == "double swing"
    assert Titles(title="RLC circuit").of_experiment("rlc") == "RLC circuit"


def test_methods_without_parameters_get_a_note(tmp_path):
    tables = tables_of(write_metrics(tmp_path, labels=("Mean", "ML only")))
    notes = [
        parameters.parameters(loaded({"mean": write_forecasts(tmp_path)["mean"]})),
        dots.parameter_errors(rows_of(tables), PlotJob(labels=[])),
    ]
    assert [figure.texts[0].get_text() for figure in notes] == ["no method estimates parameters"] * 2
    plotting.save_all({tmp_path / "note.png": notes[0]})
    assert plotting.NOTE.encode() in (tmp_path / "note.png").read_bytes()
    rows = pd.read_csv(tables[0])
    unknown = rows[rows["metric"] == "log_mse_sum"].assign(metric="relative_error", n=0, of=0, mean=np.nan)
    pd.concat([rows, unknown]).to_csv(tables[0], index=False)
    figure = dots.parameter_errors(rows_of(tables), PlotJob(labels=[]))
    assert figure.texts[0].get_text() == "the true parameters are not known"


def test_bad_input(tmp_path):
    tables, paths = tables_of(write_metrics(tmp_path / "m")), write_forecasts(tmp_path / "f")
    with pytest.raises(InputError, match=r"suffix '\.svg'"):
        plotting.save_all({tmp_path / "x.svg": dots.log_mse(rows_of(tables), PlotJob(labels=[]))})
    other = pd.read_csv(tables[0]).query("set == 'test'").assign(set="held_out")
    other.to_csv(tmp_path / "other.csv", index=False)
    with pytest.raises(InputError, match="no log_mse_sum on train, validation, iid, test"):
        dots.log_mse(rows_of([tmp_path / "other.csv"]), PlotJob(labels=[]))
    with pytest.raises(InputError, match="no seed 9; it has 0, 1"):
        traces.forecasts(loaded(paths), view=View(seed=9))
    with pytest.raises(InputError, match="no set 'held_out'"):
        traces.forecasts(loaded(paths), view=View(set="held_out"))
    with pytest.raises(InputError, match="no sample 5"):
        traces.forecasts(loaded(paths), view=View(samples=[5]))
    with pytest.raises(InputError, match="other samples"):
        traces.forecasts(loaded(paths | {"other": write_forecasts(tmp_path / "g", count=50)["hybrid"]}))
    (tmp_path / "torn.npz").write_bytes(paths["mean"].read_bytes()[:500])
    with pytest.raises(InputError, match="not a forecast file"):
        Forecasts.load(tmp_path / "torn.npz")
    np.savez(tmp_path / "short.npz", t=np.arange(3))
    with pytest.raises(InputError, match="no array 'observed'"):
        Forecasts.load(tmp_path / "short.npz")
    with pytest.raises(InputError, match="none of them has the metrics"):
        traces.curves(map(read_log, write_logs(tmp_path / "l", steps=0)))
    with pytest.raises(InputError, match="forecasts: no file"):
        traces.forecasts({})


def test_a_seed_that_could_not_be_trained_is_not_drawn(tmp_path):
    paths = write_forecasts(tmp_path, labels=("Hybrid",), seeds=(0, 1))
    arrays = dict(np.load(paths["hybrid"]))
    arrays["test_z_e_hat"][0] = arrays["validation_z_e_hat"][0] = 50
    np.savez(paths["hybrid"], **arrays, failed=[0])
    figure = parameters.parameters(loaded(paths))
    assert not figure.axes[0].texts, "nothing is outside"
    figure = traces.forecasts(loaded(paths))
    line = figure.axes[0].lines[-1].get_ydata()
    np.testing.assert_array_equal(line, arrays["test_prediction"][1, 0, :, 0])
    assert figure.get_suptitle().endswith("seed 1")


def test_a_figure_has_no_date_and_the_resolution_asked_for(tmp_path):
    figure = plotting.new_figure(1.0, 2.0)
    plotting.save(figure, tmp_path / "a", dpi=50)
    assert imread(tmp_path / "a.png").shape[:2] == (50, 100)
    assert (
        b"CreationDate" not in (tmp_path / "a.pdf").read_bytes()
        and b"Software" not in (tmp_path / "a.png").read_bytes()
    )


def test_words_keep_to_the_width_that_they_have():
    lines = plotting.wrap_words("APHYNITY (diffusion alone), the other way round", 1.1).splitlines()
    assert len(lines) > 2 and max(map(len, lines)) <= 17
    assert plotting.wrap_words("APHYNITY", 0.3) == "APHYNITY", "a word stays whole"
