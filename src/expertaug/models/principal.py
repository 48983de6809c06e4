"""Principal components of the z_a of windows, in their standard deviations."""

from __future__ import annotations

import torch
from torch import Tensor

DEAD = 1e-5  # of the whole: a principal component with a smaller standard deviation does not vary


def principal_axes(latents: Tensor, components: int) -> Tensor:
    """The first axes (C, Q) of z_a (N, Q), each as long as its standard deviation; zero where nothing varies."""
    spread = (latents - latents.mean(0, keepdim=True)).double()
    squares, columns = torch.linalg.eigh(spread.mT @ spread / max(len(latents) - 1, 1))
    std = squares.flip(0)[:components].clamp_min(0.0).sqrt()
    alive = std > DEAD * squares.clamp_min(0.0).sum().sqrt()
    return columns.mT.flip(0)[:components] * torch.where(alive, std, 0.0).unsqueeze(-1)


def scores_of(deviations: Tensor, axes: Tensor) -> Tensor:
    """Scores (…, N, C), in standard deviations, of deviations from the mean (…, N, Q) along axes (…, C, Q)."""
    squares = axes.square().sum(-1)
    inverse = torch.where(squares > 0, 1 / squares.clamp_min(1e-30), 0.0).unsqueeze(-1) * axes
    return deviations @ inverse.transpose(-1, -2)
