"""What a user gives is taken in whatever form it has, and refused in one line where it cannot be used."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import expertaug as ea
from expertaug.api import arguments
from expertaug.errors import InputError

T = np.arange(5) * 0.1


def test_arrays_go_in_as_float32_and_come_back_as_they_were():
    for given in ([[1, 2]], np.array([[1.0, 2.0]]), torch.tensor([[1, 2]])):
        taken = arguments.tensor(given, "y")
        assert taken.dtype == torch.float32 and taken.tolist() == [[1.0, 2.0]]
        assert isinstance(arguments.like(taken, given), torch.Tensor) == isinstance(given, torch.Tensor)
    assert torch.isnan(arguments.tensor([1.0, np.nan], "y", gaps=True)).tolist() == [False, True]


def test_what_all_seeds_share_stands_once_for_each():
    value = torch.arange(24.0).reshape(4, 3, 2)
    shared = arguments.stack_seeds(value, 5)
    assert shared.shape == (3, 5, 4, 2)
    assert all(torch.equal(shared[:, k].movedim(0, 1), value) for k in range(5))


def test_numbers_of_any_kind_are_noise_ranges_and_seeds():
    assert arguments.noise(np.float32(0.5)) == 0.5 and arguments.noise("estimated") == "estimated"
    assert arguments.noise({"x": 1}) == {"x": 1.0}
    assert arguments.ranges({"b": (1, 2), "a": np.array([0, 1])}, ["a", "b"], "prior") == {"a": [0, 1], "b": [1, 2]}
    assert arguments.seeds_of(np.arange(3)) == [0, 1, 2] and arguments.share(1, "worst") == 1.0


def test_times_may_differ_by_rounding_alone():
    arguments.same_times(T.astype(np.float32).astype(float), T, "t", "")
    for other in (T[:4], T + 1e-3):
        with pytest.raises(InputError, match=r"t: has the times 0.* the model knows 0, 0.1 … 0.4 s \(5 points\): cut"):
            arguments.same_times(other, T, "t", "cut")


def test_results_do_not_depend_on_the_number_of_threads_which_is_restored():
    before = torch.get_num_threads()
    with pytest.raises(ZeroDivisionError), arguments.one_thread():
        assert torch.get_num_threads() == 1
        raise ZeroDivisionError
    assert torch.get_num_threads() == before


@pytest.mark.parametrize(
    ("call", "expected"),
    [
        (lambda: arguments.tensor([[1.0], ["x"]], "y"), "y: no array of numbers"),
        (lambda: arguments.tensor(torch.tensor([1j]), "y"), "y: has complex numbers"),
        (lambda: arguments.tensor([[1.0, np.nan]], "y"), r"y: is not finite, first at index \(0, 1\)"),
        (lambda: arguments.tensor([np.inf], "y", gaps=True), r"y: is not finite, first at index \(0,\)"),
        (lambda: arguments.times([[0.0]]), r"t: has shape \(1, 1\)"),
        (lambda: arguments.times([0.0, 0.2, 0.2, 0.3]), "t: does not increase from time to time: 0, 0.2 … 0.3 s"),
        (lambda: arguments.noise({"x": -1}), "noise.x: found -1"),
        (lambda: arguments.noise("estimatd"), "noise: found 'estimatd'"),
        (lambda: arguments.ranges({"a": (1, 0)}, ["a"], "p"), r"p.a: found \[1, 0\]; low must not exceed high"),
        (lambda: arguments.ranges({"a": 1}, ["a"], "p"), r"p.a: found 1; give \[low, high\]"),
        (lambda: arguments.ranges({}, ["a"], "p"), "p: gives nothing"),
        (lambda: arguments.share(True + 1, "worst"), "worst: found 2"),
        (lambda: arguments.seeds_of([0, 0]), "seeds: found"),
        (lambda: arguments.seeds_of([True]), "seeds: found"),
        (lambda: arguments.check_observed(0.05, T), "observed_s: found 0.05"),
        (lambda: arguments.check_observed(0.6, T), "observed_s: found 0.6"),
        (lambda: arguments.solver("rk4", "solver"), "solver: found 'rk4'"),
        (lambda: arguments.trajectories(T, "train"), "train: is ndarray"),
        (lambda: arguments.start({"omga": (0, 1)}, ea.DampedPendulum()), "start.omga: 'omga' is no component"),
    ],
)
def test_what_cannot_be_used_is_one_line(call, expected):
    with pytest.raises(InputError, match=f"^{expected}") as caught:
        call()
    assert "\n" not in str(caught.value)


def test_known_inputs_are_those_of_the_system_at_all_times():
    system, u = ea.DrivenPendulum(), np.ones((2, 5, 1))
    assert arguments.inputs(u, system, 2, T).shape == (2, 5, 1)
    assert arguments.inputs(None, ea.DampedPendulum(), 2, T) is None
    for given, of, expected in (
        (u[:, :4], system, r"u: has shape \(2, 4, 1\); give \(2, 5, 1\), torque at all times of t"),
        (None, system, "u"),
        (u, ea.DampedPendulum(), "u"),
    ):
        with pytest.raises(InputError, match=f"^{expected}"):
            arguments.inputs(given, of, 2, T)
