"""Checkpoint files: a damaged one is told and never used."""

import pytest
import torch

from expertaug.errors import InputError
from expertaug.learning.job import MAGIC, Checkpoint, _digest
from expertaug.learning.train import run_stage as train
from expertaug.models import store

STATE = {"model": {"weight": torch.arange(3.0)}, "epoch": 7, "log": {"id": "x", "offset": 3}}


@pytest.fixture
def checkpoint(tmp_path):
    found = Checkpoint(tmp_path / "work", "fingerprint")
    found.save(STATE)
    return found


def test_what_is_saved_is_loaded(checkpoint, caplog):
    found = checkpoint.load()
    assert torch.equal(found.pop("model")["weight"], STATE["model"]["weight"])
    assert found == {"epoch": 7, "log": {"id": "x", "offset": 3}}
    assert Checkpoint(checkpoint.work, "another").load() is None
    assert Checkpoint(checkpoint.work / "none", "fingerprint").load() is None
    assert caplog.messages == []


def test_every_flipped_bit_is_noticed(checkpoint, caplog):
    whole = checkpoint.file.read_bytes()
    places = [*range(len(MAGIC) + 80), *range(len(MAGIC) + 80, len(whole), 7)]
    for number, place in enumerate(places, 1):
        flipped = bytearray(whole)
        flipped[place] ^= 1 << place % 8
        checkpoint.file.write_bytes(flipped)
        assert checkpoint.load() is None, place
        assert len(caplog.messages) == number, place
    assert all("checkpoint.pt: damaged" in message and "\n" not in message for message in caplog.messages)


def sealed(payload: bytes) -> bytes:
    """A payload whose digest is right, as nothing but another program can make."""
    return b" ".join((MAGIC, b"fingerprint", _digest(b"fingerprint", payload))) + b"\n" + payload


@pytest.mark.parametrize("content", [b"", b"half", b"\n", MAGIC, sealed(b""), sealed(b"no pickle")])
def test_whatever_else_lies_there_is_no_checkpoint(checkpoint, content, caplog):
    checkpoint.file.write_bytes(content)
    assert checkpoint.load() is None
    checkpoint.file.unlink()
    checkpoint.file.mkdir()
    with pytest.raises(InputError, match=r"checkpoint.pt: is a folder; remove it"):
        checkpoint.load()
    assert len(caplog.messages) == 1


def test_a_training_beside_a_damaged_checkpoint_starts_afresh(data, trained, settings, tmp_path):
    (tmp_path / "work").mkdir()
    torch.save({"fingerprint": "x"}, tmp_path / "work/checkpoint.pt")
    train(data, tmp_path / "model.safetensors", tmp_path / "work", settings, None)
    states = [store.load(path).model.state_dict() for path in (trained, tmp_path / "model.safetensors")]
    assert all(torch.equal(value, states[1][key]) for key, value in states[0].items())
