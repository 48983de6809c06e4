"""What stands for values of a window that nobody measured: NaN in a tensor of states.

An encoder is given the window with its gaps filled: each component by straight lines between its measured values,
constant before the first and after the last, and by the middle of its range where it has none.  No loss and no metric
sees what is filled in.  Where the first point has a gap, a network estimates what a forecast starts from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.networks.layers import MLP
from expertaug.systems import System
from expertaug.windows import Windows, fill
from expertaug.wording import check_keys

LAYERS = (64, 64)  # of the network that estimates first points


class Gaps(nn.Module):
    """Filled windows and estimated first points, of states that are vectors; known inputs have no gaps.

    Arguments:
        times: of the observed window in s, (T1,).
        ranges: component → [least, greatest] value of a first point, in its unit.

    Raises:
        InputError: the state is no vector, or a component has no range.
    """

    def __init__(self, system: System, times: Tensor, ranges: Mapping[str, Sequence[float]]) -> None:
        super().__init__()
        if len(system.state_shape) != 1:
            problem = f"states of {type(system).__name__} have the shape {system.state_shape}"
            raise InputError("trajectories", problem, "only vectors may have values that are not measured")
        names = [p.name for p in system.state]
        if missing := [name for name in names if name not in ranges]:
            remedy = "give the range [low, high] of its first value (data.start)"
            raise InputError(f"start.{missing[0]}", "missing, nobody measured it", remedy)
        # All seeds share them, and a file's description has them.
        self.times, (self.middle, self.width) = times, ends_of({name: ranges[name] for name in names})
        self.network = MLP(2 * len(times) * len(names), LAYERS, len(names), "silu")

    def filled(self, windows: Windows) -> Windows:
        """Observed windows without gaps; the same where they have none."""
        return windows.filled(self.times, self.middle.to(windows.y))

    def start(self, windows: Windows) -> Tensor:
        """First points (…, B, K) of observed windows: as measured, and estimated from the states of the window where
        they were not."""
        observed, measured = windows.y, windows.measured
        if measured[0].all():
            return observed[0]
        middle, width = self.middle.to(observed), self.width.to(observed)
        scaled = (fill(observed, self.times, middle) - middle) / width
        inputs = torch.cat((scaled, measured.to(scaled)), -1).movedim(0, -2).flatten(-2)
        estimate = middle + width * torch.tanh(self.network(inputs))
        return torch.where(measured[0], observed[0], estimate)


def ends_of(ranges: Mapping[str, Sequence[float]], like: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Middle and half the width (K,) of ranges by component, in their order; in the type of another tensor."""
    ends = torch.tensor([[float(end) for end in pair] for pair in ranges.values()], dtype=torch.float64)
    ends = ends if like is None else ends.to(like)
    return ends.mean(1), ((ends[:, 1] - ends[:, 0]) / 2).clamp_min(1e-6)


def ranges_of(
    names: Sequence[str], low: Sequence[float], high: Sequence[float], start: Mapping[str, Sequence[float]]
) -> dict[str, list[float]]:
    """Ranges of the components of first points: those of ``start``, and a tenth more than the measured values'.

    Arguments:
        low, high: of the measured values, (K,), NaN of a component that nobody measured.

    Raises:
        InputError: a range of what the state does not have.
    """
    check_keys(start, names, "start", "component of the state")
    ranges = {name: [float(v) for v in start[name]] for name in start}
    for name, least, greatest in zip(names, low, high, strict=True):
        if name not in ranges and least <= greatest:
            margin = max(0.1 * (greatest - least), 1e-3 * max(abs(least), abs(greatest)), 1e-9)
            ranges[name] = [float(least - margin), float(greatest + margin)]
    return ranges
