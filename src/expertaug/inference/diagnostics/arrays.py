"""Arrays that diagnostics are given: NumPy or torch in, float64 NumPy out, checked."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from expertaug.errors import InputError

if TYPE_CHECKING:  # stages that make tables of what is computed already start without torch
    from torch import Tensor

Array: TypeAlias = "np.ndarray | Tensor"


def plain(value: object, name: str, *, infinite: bool = False) -> np.ndarray:
    """A float64 array of what was given.

    Arguments:
        infinite: whether infinite values may stand in it.

    Raises:
        InputError: no array of numbers, none at all, or a value that is not finite.
    """
    detach = getattr(value, "detach", None)  # a tensor's
    try:
        array = np.asarray(value if detach is None else detach().cpu(), dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(name, f"no array of numbers ({error})", "give a NumPy array or a torch tensor") from error
    if not array.size:
        raise InputError(name, f"is empty, of shape {array.shape}", "give at least one window")
    bad = np.isnan(array) if infinite else ~np.isfinite(array)
    if bad.any():
        where = tuple(int(k) for k in np.argwhere(bad)[0])
        raise InputError(name, f"is {array[where]} at index {where}", "leave such windows out, and count them")
    return array


def draws_and_truth(samples: object, truth: object, least: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Draws (K, N, …) and the truth (N, …) of the same windows.

    Arguments:
        least: the fewest draws that will do.

    Raises:
        InputError: the shapes disagree, or there are fewer draws.
    """
    draws, true = plain(samples, "samples"), plain(truth, "truth")
    if true.ndim < 1 or draws.shape[1:] != true.shape:
        raise InputError("samples", f"have shape {draws.shape}, the truth {true.shape}", "give (K, N, …) and (N, …)")
    if len(draws) < least:
        raise InputError("samples", f"{len(draws)} draw a window", f"give at least {least}")
    return draws, true


def per_window(first: np.ndarray, second: np.ndarray, names: str) -> None:
    """Two arrays with one number a window each.

    Raises:
        InputError: they are not (N,) both.
    """
    if first.ndim != 1 or first.shape != second.shape:
        raise InputError(names, f"have shapes {first.shape} and {second.shape}", "give (N,) both, one number a window")
