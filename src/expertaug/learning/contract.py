"""What an objective must give, checked where it is used."""

from __future__ import annotations

from torch import Tensor

from expertaug.errors import InputError


def check_loss(objective: object, loss: object, seeds: int) -> Tensor:
    """The loss of a group of seeds: one number a seed, (S,).

    Raises:
        InputError: it has another shape; a single number would divide every gradient by the number of seeds.
    """
    if not isinstance(loss, Tensor) or tuple(loss.shape) != (seeds,):
        found = f"shape {tuple(loss.shape)}" if isinstance(loss, Tensor) else type(loss).__name__
        remedy = f"give one number for each seed, ({seeds},): average over all axes but the seeds'"
        raise InputError("objective", f"the loss of {type(objective).__name__} has {found}", remedy)
    return loss
