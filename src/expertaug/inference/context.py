"""What a posterior sees of an observed window: numbers of what somebody measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from expertaug.models.encoders.fields import Moments
from expertaug.models.encoders.window import ComponentView
from expertaug.models.gaps import ends_of, fill
from expertaug.systems import System
from expertaug.systems.inputs import observed as as_observed


class Context(nn.Module):
    """The observed window as the base model's encoder is allowed to see it: its windows of components where it has
    some, else every observed quantity and known input; of fields their moments.  Where values may not have been
    measured, straight lines stand for them, and which ones they are is seen as well.

    Arguments:
        times: of the observed window in s, (T1,).
        encoder: the base model's settings of its encoder.
        ranges: of the components of first points, where values may not have been measured (NaN).

    Attributes:
        inputs: how many numbers :meth:`forward` gives.
    """

    def __init__(
        self,
        system: System,
        times: Tensor,
        encoder: Mapping,
        ranges: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        super().__init__()
        system = as_observed(system)
        self.system, self.moments, self.windows = system, None, None
        self.times, self.middle = times, None if ranges is None else ends_of(ranges)[0]
        if len(system.state_shape) > 1:
            self.moments = Moments(system, len(times), encoder.get("powers") or (1, 3))
            self.inputs = self.moments.outputs
        elif encoder.get("windows"):
            self.windows = ComponentView(system, times, encoder["windows"], encoder.get("angles", ()))
            self.inputs = self.windows.inputs
        else:
            self.inputs = len(times) * system.observe(torch.zeros(1, *system.state_shape)).shape[-1]
        if ranges is not None:
            self.inputs += len(times) * len(ranges)

    def fit(self, observed: Tensor) -> None:
        """Learn the moments' scales from windows (T1, N, *observed)."""
        if self.moments is not None:
            self.moments.fit(observed.movedim(0, 1))

    def forward(self, observed: Tensor) -> Tensor:
        """(T1, …, B, *observed) → (…, B, inputs)."""
        if self.middle is None:
            return self._seen(observed)
        gaps = torch.isnan(observed[..., : len(self.middle)]).to(observed)
        filled = fill(observed, self.times, self.middle.to(observed))
        return torch.cat((self._seen(filled), gaps.movedim(0, -2).flatten(-2)), dim=-1)

    def _seen(self, observed: Tensor) -> Tensor:
        if self.moments is not None:
            return self.moments(observed.movedim(0, -2 - self.moments.rank))
        if self.windows is not None:
            return self.windows.features(self.windows(observed))
        return self.system.observe(observed).movedim(0, -2).flatten(-2)
