"""Trained models: their forecasts, their seeds, their scores and their files."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from small_pendulum import ENCODER, INTERACTION, OPTIONS, T

import expertaug as ea
from expertaug.api import trained


class TestForecast:
    def test_numpy_in_numpy_out_and_torch_in_torch_out(self, fit, sets):
        window = sets["test"].y[:, :11]
        found = fit.forecast(window, T)
        assert isinstance(found.y, np.ndarray) and found.y.shape == (2, 10, 21, 2)
        assert found.z_e["omega0"].shape == (2, 10) and found.units["z_e omega0"] == "rad/s"
        same = fit.forecast(torch.from_numpy(window), torch.from_numpy(T))
        assert isinstance(same.y, torch.Tensor) and isinstance(same.z_e["omega0"], torch.Tensor)
        np.testing.assert_array_equal(same.y.numpy(), found.y)
        np.testing.assert_array_equal(trained.forecast(fit, window.astype(float), list(T)).y, found.y)

    def test_one_seed_of_the_group(self, fit, sets):
        window = sets["test"].y[:, :11]
        rk4 = ea.Solver("rk4")  # an adaptive one takes steps that suit all of a group
        whole = fit.forecast(window, T, solver=rk4)
        assert len(fit) == 2 and [one.seeds for one in fit] == [[0], [1]]
        for k, one in enumerate(fit):
            alone = one.forecast(window, T, solver=rk4)
            assert alone.y.shape == (10, 21, 2) and alone.z_e["omega0"].shape == (10,)
            np.testing.assert_allclose(alone.y, whole.y[k], atol=1e-5)
            np.testing.assert_allclose(one.estimate(window, T[:11])["omega0"], whole.z_e["omega0"][k], rtol=1e-5)
        assert fit[-1].seeds == [1] and fit[:1].forecast(window, T).y.shape == (1, 10, 21, 2)
        assert set(fit[1].history["seed"]) == {1} and fit[1].evaluate(sets["test"])["seed"].unique().tolist() == [1]
        with pytest.raises(IndexError):
            fit[2]

    def test_any_times_may_follow_the_window(self, fit, sets):
        window = sets["test"].y[:, :11]
        later = np.concatenate((T[:11], [1.55, 3.0, 7.0]))
        found = fit[0].forecast(window, later)
        assert found.y.shape == (10, 14, 2) and np.isfinite(found.y).all()
        np.testing.assert_array_equal(fit[0].forecast(window, T, start="y_t1").y[:, :11], window)

    def test_without_the_expert_there_are_no_estimates(self, sets):
        agnostic = ea.HybridModel(ea.DampedPendulum(), ENCODER, INTERACTION, expert=False)
        found = ea.fit(agnostic, sets["train"], sets["validation"], observed_s=1.0, **OPTIONS | {"epochs": 1})
        window = sets["test"].y[:, :11]
        assert found.estimate(window, T[:11]) == {} and found.forecast(window, T).z_e == {}
        assert "relative_error" not in set(found.evaluate(sets["test"])["metric"])

    def test_the_expert_forecasts_with_the_estimates(self, sets, recipe):
        alone = ea.HybridModel(ea.DampedPendulum(), ENCODER)
        model = ea.fit(alone, sets["train"], sets["validation"], observed_s=1.0, epochs=1)
        found = model[0].forecast(sets["test"].y[:3, :11], T)
        z_e = torch.from_numpy(found.z_e["omega0"]).unsqueeze(-1)
        expert = model.solver(
            lambda s, y: ea.DampedPendulum().expert(s, y, z_e),
            torch.from_numpy(found.y[:, 0]),
            torch.from_numpy(T).float(),
        )
        np.testing.assert_allclose(found.y, expert.movedim(0, 1).numpy(), atol=1e-6)

    @pytest.mark.parametrize(
        ("change", "t", "expected"),
        [
            (lambda y: y[0], T, r"window: has shape \(11, 2\); give \(N, 11, 2\): the state is theta, omega"),
            (lambda y: y[..., :1], T, r"window: has shape \(10, 11, 1\)"),
            (lambda y: y[:, :9], T, r"window: has the times 0, 0.1 … 0.8 s \(9 points\); the model knows 0, 0.1 … 1 s"),
            (lambda y: y, T * 2, r"window: has the times 0, 0.2 … 2 s"),
            (lambda y: y, T + 5, "window: has the times 5, 5.1"),
            (lambda y: y, T[:5], "window: has the times"),
            (lambda y: y, T[::-1], "t: does not increase"),
            (lambda y: np.where(y == y[3, 2, 1], np.nan, y), T, r"window: is not finite, first at index \(3, 2, 1\)"),
            (lambda y: [["a"]], T, "window: no array of numbers"),
        ],
    )
    def test_a_window_of_another_sampling_is_refused_in_one_line(self, fit, sets, change, t, expected):
        with pytest.raises(ea.InputError, match=expected) as caught:
            fit.forecast(change(sets["test"].y[:, :11]), t)
        assert "\n" not in str(caught.value)


def test_seeds_are_taken_by_a_place_a_slice_or_their_places(fit):
    assert [fit[place].seeds for place in (-1, np.int64(1), slice(1), [1, 0])] == [[1], [1], [0], [1, 0]]
    assert fit[np.int64(1)].single and not fit[[1]].single


def test_a_device_that_there_is_not_is_told_before_a_file_is_read(fit, tmp_path):
    fit.save(tmp_path / "m")
    with pytest.raises(ea.InputError, match="device: found 'gpu'; did you mean 'cuda'"):
        trained.load(tmp_path / "m", device="gpu")


def test_several_models_in_one_table(fit, plus, sets):
    table = trained.evaluate({"a": fit, "b": plus}, sets["test"], from_s=1.5, max_samples=4)
    assert list(table.columns) == ["label", "seed", "metric", "value"] and set(table["label"]) == {"a", "b"}
