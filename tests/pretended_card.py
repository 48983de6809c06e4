"""A card that is not there: tensors that say they lie on another device, and whose values the CPU computes.

Within :class:`Card` what is made on or moved to :data:`DEVICE` behaves as on a real card: an operation that mixes such
tensors with others is refused as CUDA refuses it (single numbers and indices may lie on the CPU), and every place at
which the program would wait for the card is noted.  The device is torch's ``meta``, the only one that torch without
CUDA differentiates on; it has no values of its own, so that these are kept beside.
"""

from __future__ import annotations

import collections
import sys
from pathlib import Path

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_map

import expertaug

DEVICE = torch.device("meta")
SOURCE = str(Path(expertaug.__file__).parent)
aten = torch.ops.aten
MOVES = (aten._to_copy.default, aten.copy_.default)
INDEXING = (aten.index.Tensor, aten.index_put.default, aten.index_put_.default, aten._index_put_impl_.default)
# Their result's shape or value is needed on the CPU.
WAITS = (aten._local_scalar_dense.default, aten.equal.default, aten.nonzero.default, aten.masked_select.default)
ITEMS = (Tensor.__getitem__, Tensor.__setitem__)
FROM_NUMBERS = (torch.tensor, torch.as_tensor, Tensor.new_tensor)


class WrongDevice(RuntimeError):
    """What CUDA would say of tensors on two devices."""


class OnCard(Tensor):
    """A tensor on the card; ``value`` is it on the CPU."""

    value: Tensor
    __torch_function__ = torch._C._disabled_torch_function_impl

    @staticmethod
    def __new__(cls, value: Tensor) -> OnCard:
        made = Tensor._make_wrapper_subclass(
            cls,
            value.size(),
            strides=value.stride(),
            storage_offset=value.storage_offset(),
            dtype=value.dtype,
            device=DEVICE,
        )
        made.value = value.detach()
        return made

    @classmethod
    def __torch_dispatch__(cls, func, types, args=(), kwargs=None):
        raise WrongDevice(f"{func} outside of the card's context")


class Card(TorchDispatchMode):
    """The context in which there is a card.

    Attributes:
        waits: how often the program waited for the card, by place (file and line in the package).
    """

    def __init__(self) -> None:
        super().__init__()
        self.waits: collections.Counter[str] = collections.Counter()
        self.numbers = Numbers(self.waits)

    def __enter__(self) -> Card:
        self.numbers.__enter__()
        return super().__enter__()

    def __exit__(self, *error) -> None:
        super().__exit__(*error)
        self.numbers.__exit__(*error)

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        kwargs, device = dict(kwargs or {}), None
        if kwargs.get("device") is not None:
            device = torch.device(kwargs["device"])
            kwargs["device"] = torch.device("cpu")
        tensors = [x for x in tree_flatten((args, kwargs))[0] if isinstance(x, Tensor)]
        here = any(isinstance(x, OnCard) for x in tensors)
        if here:
            self._check(func, tensors)
        self._note(func, args, kwargs, device)
        found = func(*tree_map(_value, args), **tree_map(_value, kwargs))
        if func in MOVES or device is not None:
            onto = isinstance(args[0], OnCard) if func is aten.copy_.default else (device or args[0].device) == DEVICE
        else:
            onto = here
        if not onto or func in WAITS[:2]:
            return found
        if func._schema.name.endswith("_") and isinstance(args[0], OnCard):
            return args[0]  # changed in place
        if "out" in kwargs:
            return (kwargs if isinstance(kwargs["out"], OnCard) else {"out": found})["out"]
        return tree_map(lambda x: OnCard(x) if isinstance(x, Tensor) else x, found)

    def _check(self, func, tensors: list[Tensor]) -> None:
        if func in MOVES:
            return
        single = torch.Tag.pointwise in func.tags or func._schema.name.startswith("aten::searchsorted")
        for x in tensors:
            fits = isinstance(x, OnCard) or (single and x.dim() == 0)
            if not fits and not (func in INDEXING and not x.is_floating_point() and isinstance(tensors[0], OnCard)):
                raise WrongDevice(f"{func}: a tensor {tuple(x.shape)} of the CPU beside those on the card")

    def _note(self, func, args: tuple, kwargs: dict, device: torch.device | None) -> None:
        here = isinstance(args[0], OnCard) if args else False
        wait = here and func in WAITS
        if here and func in INDEXING[:3]:
            wait = any(x is not None and x.dtype in (torch.bool, torch.uint8) for x in args[1])
        if func is aten._to_copy.default and device is not None:
            wait = (device == DEVICE) != here
            wait &= device != DEVICE or not kwargs.get("non_blocking")  # what is sent may still be under way
        if func is aten.copy_.default:
            wait = here != isinstance(args[1], OnCard)
        if wait:
            self.waits[_place()] += 1


class Numbers(TorchFunctionMode):
    """Tensors of plain numbers, and lists as indices: torch would make them on ``meta`` without values."""

    def __init__(self, waits: collections.Counter[str]) -> None:
        super().__init__()
        self.waits = waits

    def __torch_function__(self, func, types, args=(), kwargs=None):
        kwargs = dict(kwargs or {})
        if func in ITEMS and isinstance(args[0], OnCard):
            return func(args[0], self._index(args[1]), *args[2:])
        if func is Tensor.tolist and isinstance(args[0], OnCard):
            return args[0].cpu().tolist()
        if func not in FROM_NUMBERS:
            return func(*args, **kwargs)
        if func is Tensor.new_tensor:
            like, args = args[0], args[1:]
            kwargs = {"dtype": like.dtype, "device": like.device} | kwargs
            func = torch.tensor
        device = kwargs.pop("device", None)
        if device is None and isinstance(args[0], Tensor):
            device = args[0].device
        found = func(*args, **kwargs)
        return found if device is None else found.to(device)

    def _index(self, index):
        """An index whose lists are tensors: a list is sent to the card, which the program waits for."""
        if isinstance(index, tuple):
            return tuple(self._index(one) for one in index)
        if not isinstance(index, list):
            return index
        self.waits[_place()] += 1
        return torch.tensor(index)


def _value(x):
    return x.value if isinstance(x, OnCard) else x


def _place() -> str:
    """The innermost line of the package that runs."""
    frame = sys._getframe()
    while frame is not None and not frame.f_code.co_filename.startswith(SOURCE):
        frame = frame.f_back
    return "elsewhere" if frame is None else f"{frame.f_code.co_filename.removeprefix(SOURCE)[1:]}:{frame.f_lineno}"
