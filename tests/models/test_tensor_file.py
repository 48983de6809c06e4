"""Files of tensors with a header: a damaged one is refused, and nothing is written that cannot be read."""

from __future__ import annotations

import struct

import numpy as np
import pytest
import torch

from expertaug.errors import InputError
from expertaug.models import store
from expertaug.models.tensor_file import read_tensors, write_tensors
from model_files import write


def test_a_flipped_bit_is_found_wherever_it_is(tmp_path):
    path = tmp_path / "m"
    write(path)
    whole = path.read_bytes()
    description, tensors = read_tensors(path)
    for bit in np.random.default_rng(0).integers(0, 8 * len(whole), 300):
        damaged = bytearray(whole)
        damaged[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(damaged)
        try:
            again, values = read_tensors(path)
        except InputError as error:
            assert "\n" not in str(error)
        else:  # a blank in the header's padding
            assert again == description and all(torch.equal(values[k], v) for k, v in tensors.items())


def test_the_same_content_is_the_same_bytes(tmp_path):
    header = {"name": 'a "b"\n\t\\ θ°\x01/', "of": [1, 2.5]}
    files = []
    for k in range(12):
        write_tensors(tmp_path / str(k), {"b": torch.ones(3), "a": torch.zeros(2, dtype=torch.int64)}, header)
        files.append((tmp_path / str(k)).read_bytes())
    assert len(set(files)) == 1
    read, tensors = read_tensors(tmp_path / "0")
    assert read == header and tensors["b"].tolist() == [1, 1, 1] and tensors["a"].dtype == torch.int64


def test_what_json_cannot_hold_is_refused_and_nothing_is_written(tmp_path):
    with pytest.raises(InputError, match=r"cannot describe this .*ReLU is neither a number nor a text"):
        write_tensors(tmp_path / "m", {"a": torch.zeros(2)}, {"activation": torch.nn.ReLU()})
    assert not list(tmp_path.iterdir())
    write_tensors(tmp_path / "m", {"a": torch.zeros(2)}, {"windows": {"theta": np.array([0, 5])}, "n": np.float64(0.5)})
    assert read_tensors(tmp_path / "m")[0] == {"windows": {"theta": [0, 5]}, "n": 0.5}


def test_a_header_longer_than_the_file(tmp_path):
    (tmp_path / "m").write_bytes(struct.pack("<Q", 10**12) + b"{}")
    with pytest.raises(InputError, match="not a file of this package"):
        store.load(tmp_path / "m")
