"""Windows of trajectories: what they refuse, and that cutting, choosing and joining commute."""

import numpy as np
import pytest
import torch

from expertaug.errors import InputError
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows, fill

# Times, seeds, samples, shape of a state, known inputs.
SIZES = [(4, 2, 3, (2,), 0), (4, 3, 5, (2,), 2), (5, 2, 2, (1, 4), 1), (2, 2, 4, (2, 3, 3), 0), (3, 2, 3, (2, 3, 3), 2)]
of_sizes = pytest.mark.parametrize("sizes", SIZES, ids=str)


def windows(times: int, seeds: int, samples: int, state: tuple[int, ...], inputs: int, gaps: bool = False) -> Windows:
    """A group's windows of numbers that are all different."""
    generator = torch.Generator().manual_seed(0)
    y = torch.rand(times, seeds, samples, *state, generator=generator)
    if gaps:
        y = torch.where(torch.rand(y.shape, generator=generator) < 0.4, torch.nan, y)
    u = torch.rand(times, seeds, samples, inputs, generator=generator) if inputs else None
    return Windows(torch.arange(times) * 0.1, y, u)


def equal(one: Windows, other: Windows) -> bool:
    pairs = [(one.t, other.t), (one.y, other.y), *([] if one.u is None else [(one.u, other.u)])]
    return (one.u is None) == (other.u is None) and all(torch.equal(a, b) for a, b in pairs)


@pytest.mark.parametrize(
    ("tensors", "expected"),
    [
        ((torch.arange(3.0), torch.zeros(4, 2, 2)), r"y has shape \(4, 2, 2\) for times of shape \(3,\)"),
        ((torch.arange(3.0), torch.zeros(3, 2)), r"y is \(T1, …, B, \*state\)"),
        ((torch.arange(3.0), torch.zeros(0, 2, 2)), "y has shape"),
        ((torch.zeros(3, 1), torch.zeros(3, 2, 2)), "times of shape"),
        ((torch.arange(3.0), torch.zeros(2, 5, 2), torch.zeros(2, 5, 1)), r"u is \(3, …, B, U\)"),
        ((torch.arange(3.0), torch.zeros(2, 5, 2), torch.zeros(3, 4, 1)), "known inputs of the same samples"),
        ((torch.arange(3.0), torch.zeros(2, 5, 2), torch.zeros(3, 5)), "u has shape"),
        ((torch.arange(3), torch.zeros(2, 5, 2)), "give floating-point numbers"),
    ],
)
def test_what_does_not_fit_together_is_one_line(tensors, expected):
    with pytest.raises(InputError, match=expected):
        Windows(*tensors)


def test_nothing_of_them_can_be_changed():
    with pytest.raises(AttributeError):
        windows(3, 1, 2, (2,), 0).y = torch.zeros(3, 1, 2, 2)


@of_sizes
def test_an_encoder_sees_states_and_then_inputs_the_same_all_over_a_field(sizes):
    made = windows(*sizes)
    *_, state, inputs = sizes
    assert made.joined.shape[3:] == (state[0] + inputs, *state[1:])
    assert made.joined[0, 0, 0].numel() == made.numbers
    assert torch.equal(made.joined.narrow(3, 0, state[0]), made.y)
    for k in range(inputs):
        seen = made.joined.select(3, state[0] + k).reshape(*made.u.shape[:3], -1)
        assert torch.equal(seen, made.u[..., k : k + 1].expand_as(seen))


@of_sizes
@pytest.mark.parametrize("points", [1, 2])
@pytest.mark.parametrize("places", [[0], [1, 0, 1], [1, 1]])
def test_cutting_and_choosing_commute_with_joining(sizes, points, places):
    made, times, index = windows(*sizes), sizes[0], torch.tensor(places)
    assert torch.equal(made.until(points).samples(index).joined, made.joined[:points, :, index])
    assert equal(made.until(points).samples(index), made.samples(index).until(points))
    assert torch.equal(made.observed(points).joined, made.until(points).joined)
    assert equal(made.observed(points).until(points), made.until(points))
    assert len(made.observed(points).t) == times and made.observed(points).points == points
    assert torch.equal(made.seed(1).joined, made.joined[:, 1])


@of_sizes
@pytest.mark.parametrize("size", [1, 2, 7])
def test_parts_one_after_the_other_are_the_whole(sizes, size):
    made = windows(*sizes)
    assert equal(Windows.cat(list(made.split(size))), made)


@of_sizes
def test_seeds_share_windows_without_a_copy(sizes):
    times, _, *rest = sizes
    shared = windows(times, 1, *rest)
    group = shared.expand(3)
    assert group.y.shape[1] == 3 and group.y.data_ptr() == shared.y.data_ptr()
    assert all(equal(group.seed(k), shared.seed(0)) for k in range(3))
    assert equal(shared.seed(0).with_seeds(), shared)


@of_sizes
def test_each_seed_has_its_own_choice_of_samples(sizes):
    made, (_, seeds, samples, *_) = windows(*sizes), sizes
    index = torch.arange(seeds).unsqueeze(1).add(torch.arange(3)).remainder(samples)
    chosen = made.at(torch.arange(seeds).unsqueeze(1), index)
    assert all(equal(chosen.seed(k), made.samples(index[k]).seed(k)) for k in range(seeds))


@pytest.mark.parametrize(("times", "samples", "inputs"), [(2, 1, 0), (5, 3, 0), (4, 20, 1), (9, 8, 2)])
def test_filling_leaves_what_was_measured_and_the_inputs(times, samples, inputs):
    made = windows(times, 2, samples, (3,), inputs, gaps=True)
    filled = made.filled(made.t, torch.tensor([0.5, 0.5, 0.5]))
    assert not filled.has_gaps and filled.u is made.u
    assert torch.equal(filled.y[made.measured], made.y[made.measured])
    assert filled.filled(made.t, torch.zeros(3)) is filled, "nothing to fill"
    low, high = made.y.nan_to_num(torch.inf).amin(0), made.y.nan_to_num(-torch.inf).amax(0)
    known = made.measured.any(0)
    assert ((filled.y >= low - 1e-6) & (filled.y <= high + 1e-6))[:, known].all(), "lines end at measured values"
    assert (filled.y[:, ~known] == 0.5).all()
    assert torch.equal(fill(made.joined, made.t, torch.tensor([0.5, 0.5, 0.5])), filled.joined)


def test_a_set_is_seen_with_its_gaps_and_inputs():
    y, mask = np.random.default_rng(0).random((4, 5, 2)), np.ones((4, 5, 2), dtype=bool)
    mask[1, 2] = False
    data = Trajectories(np.arange(5) * 0.1, y, np.zeros((4, 1)), mask=mask, u=np.ones((4, 5, 1)))
    made = Windows.of(data)
    assert made.y.shape == (5, 1, 4, 2) and made.u.shape == (5, 1, 4, 1) and made.t.dtype == torch.float32
    assert made.has_gaps and torch.isnan(made.y[2, 0, 1]).all() and made.y.is_contiguous()
    assert np.array_equal(made.until(2).y[:, 0].movedim(0, 1).numpy(), data.y[:, :2])
