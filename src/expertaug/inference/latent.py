"""Where z_a lies in training, and the coordinates in which a fit of a window seeks it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from expertaug.models.card import LatentRecord, ModelCard
from expertaug.models.posterior import scores_of


@dataclass(frozen=True)
class Latent:
    """Where the z_a of the training windows lie, and in which coordinates a fit seeks one.

    Attributes:
        mean, std: (S, Q) each.
        axes: principal axes (S, C, Q), where z_a has too many components to seek each: the others stay at their mean.
    """

    mean: Tensor
    std: Tensor
    axes: Tensor | None = None

    @classmethod
    def of(cls, card: ModelCard, components: int) -> Latent:
        """Of a model file, with at most so many coordinates; the expert alone has none."""
        known = card.latent or LatentRecord(mean=[[]], std=[[]])
        mean, std = (torch.tensor(value, dtype=torch.float64) for value in (known.mean, known.std))
        axes = None
        if known.axes is not None and mean.shape[-1] > components:
            axes = torch.tensor(known.axes, dtype=torch.float64)[:, :components]
        return cls(mean, std.clamp_min(1e-6), axes)

    @property
    def size(self) -> int:
        """Coordinates of z_a."""
        return self.mean.shape[-1] if self.axes is None else self.axes.shape[-2]

    def z_a(self, coordinates: Tensor) -> Tensor:
        """z_a (S, N, Q) of coordinates (S, N, size), in standard deviations."""
        moved = self.std.unsqueeze(1) * coordinates if self.axes is None else coordinates @ self.axes
        return self.mean.unsqueeze(1) + moved

    def coordinates(self, z_a: Tensor) -> Tensor:
        """Of z_a (S, N, Q): (S, N, size)."""
        away = z_a - self.mean.unsqueeze(1)
        return away / self.std.unsqueeze(1) if self.axes is None else scores_of(away, self.axes)

    def spread(self, std: Tensor) -> Tensor:
        """Standard deviation (S, N, Q) of z_a from that of coordinates (S, N, size), to first order."""
        if self.axes is None:
            return std * self.std.unsqueeze(1)
        return (std.square() @ self.axes.square()).sqrt()
