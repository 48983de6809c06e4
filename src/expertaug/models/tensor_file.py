"""Files of tensors with a JSON header and a digest over both: a damaged file is refused."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from expertaug.errors import InputError
from expertaug.files import atomic

HEADER, DIGEST = "expertaug", "sha256"
METADATA = "__metadata__"  # where safetensors has both


def write_tensors(path: str | Path, tensors: Mapping[str, Tensor], header: Mapping) -> None:
    """Write a safetensors file atomically.

    Raises:
        InputError: the header holds what JSON cannot, or the file cannot be written.
    """
    plain = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    try:
        text = json.dumps(header, default=_plain)
    except (TypeError, ValueError) as error:
        raise InputError(path, f"cannot describe this ({error})", "give classes numbers, texts and lists") from error
    with atomic(path) as temporary:
        save_file(plain, temporary, metadata={HEADER: text, DIGEST: _digest(text, plain)})
        _order_metadata(temporary)


def read_tensors(path: str | Path) -> tuple[dict, dict[str, Tensor]]:
    """Header and tensors of a file that this package wrote.

    Raises:
        InputError: the file is missing, damaged or from elsewhere.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            text = metadata[HEADER]
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if metadata.get(DIGEST) != _digest(text, tensors):
            raise ValueError("its content is not what was written: it is damaged, or of an earlier version")
        header = json.loads(text)
        if not isinstance(header, dict):
            raise ValueError("its header is no mapping")
    except FileNotFoundError as error:
        raise InputError(path, "no such file", "run the stage that makes it") from error
    except (KeyError, ValueError, TypeError, RecursionError, OSError, SafetensorError) as error:
        raise InputError(path, f"not a file of this package ({error})", "make it again with its stage") from error
    return header, tensors


def _order_metadata(path: Path) -> None:
    """Write a file's metadata in the order of its names: safetensors has them in any, each time another, so that the
    same content would be other bytes."""
    with path.open("r+b") as stream:
        (size,) = struct.unpack("<Q", stream.read(8))
        described = json.loads(stream.read(size))
        described[METADATA] = dict(sorted(described[METADATA].items()))
        ordered = json.dumps(described, separators=(",", ":"), ensure_ascii=False).encode()
        if len(ordered) <= size:
            stream.seek(8)
            stream.write(ordered.ljust(size))


def _digest(text: str, tensors: Mapping[str, Tensor]) -> str:
    digest = hashlib.sha256(text.encode())
    for name in sorted(tensors):
        value = tensors[name]
        digest.update(f"\n{name} {value.dtype} {tuple(value.shape)}\n".encode())
        if value.numel():
            digest.update(value.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def _plain(value: object) -> object:
    """Numbers and arrays of NumPy and torch as JSON has them."""
    if isinstance(value, (np.generic, np.ndarray, Tensor)):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(f"{type(value).__name__} is neither a number nor a text")
