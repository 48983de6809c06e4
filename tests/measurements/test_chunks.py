"""Where chunks begin, and how many of them are taken."""

from __future__ import annotations

import numpy as np
import pytest

from expertaug.errors import InputError
from expertaug.measurements.chunks import choose_chunks, chunk_starts, rows_of, space_out
from expertaug.measurements.settings import ChunkLimits, Cutting


@pytest.mark.parametrize("phases", ["all", "first"])
@pytest.mark.parametrize("step", [1, 3])
def test_chunks_lie_in_one_run_and_begin_a_stride_apart(step, phases):
    member = np.random.default_rng(0).random(300) > 0.02
    options = Cutting(length=6, stride=2, evaluation_stride=2, phases=phases)
    expected = []
    for k in range(300 - 5 * step):
        begins = max((j + 1 for j in range(k) if not member[j]), default=0)
        number, phase = divmod(k - begins, step)
        if member[k : k + 5 * step + 1].all() and number % 2 == 0 and (phases == "all" or phase == 0):
            expected.append(k)
    assert chunk_starts(member, step, options, stride=2).tolist() == expected and len(expected) > 10


def test_of_each_set_as_many_are_taken_as_the_limits_allow_and_too_few_are_refused():
    options = Cutting(length=2, stride=1, evaluation_stride=1, min_chunks=3, max_chunks=ChunkLimits(train=4))
    labels = [np.zeros(11, int), np.repeat([1, 2], 6)]
    candidates = {name: rows_of(labels, [1, 1], name, options, 1) for name in ("train", "validation", "test")}
    chosen = choose_chunks("here", candidates, options, "trials")
    assert chosen["train"].tolist() == [[0, 0], [0, 3], [0, 6], [0, 9]]
    assert chosen["test"].tolist() == [[1, k] for k in range(6, 11)]
    candidates["validation"] = candidates["validation"][:2]
    message = (
        r"here: too few chunks for the validation split \(train 10, validation 2, test 5\); at least 3 .* more trials"
    )
    with pytest.raises(InputError, match=message):
        choose_chunks("here", candidates, options, "trials")


def test_of_chunks_that_begin_anywhere_such_are_taken_as_are_a_stride_apart():
    rows = np.array([[0, 0], [0, 2], [0, 3], [1, 4], [1, 5], [1, 9]])
    assert space_out(rows, 3).tolist() == [[0, 0], [0, 3], [1, 4], [1, 9]]
