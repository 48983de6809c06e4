"""Encoders of windows of chosen components, and what an encoder looks at: those, or all observed states.

A view is called with the observed window (T1, …, B, *state) and gives what is seen of it, (…, B, *seen), which has one
state's units still; ``features`` makes network inputs (…, B, inputs) of that.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.networks.layers import MLP, Linear, Standardise, feature_count
from expertaug.models.posterior import Delta, Posterior, constrain
from expertaug.models.settings import WindowSettings, configure_by
from expertaug.systems import System
from expertaug.systems.base import constant_like


class StateView:
    """All of it: (…, B, T1, *state)."""

    def __init__(self, system: System, times: Tensor) -> None:
        self.system = system
        self.inputs = len(times) * feature_count(system, "model.encoder.kind")

    def __call__(self, observed: Tensor) -> Tensor:
        return observed.movedim(0, -1 - len(self.system.state_shape))

    def features(self, seen: Tensor) -> Tensor:
        """The system's features of every state, one after the other."""
        return self.system.features(seen).flatten(-2)


class ComponentView:
    """Windows of chosen components, (…, B, values).

    An angle enters a network as the sine and cosine of every point and, since the network must tell speeds far beyond
    its training range from differences of nearly equal angles, as the sines of the increments from point to point.

    Arguments:
        times: of the observed window in s, (T1,).
        windows: component name → [first, last] time in s, both included; the first point of every component named
            belongs to x and is seen as well.
        angles: components that enter as angles.

    Raises:
        InputError: a component is unknown or a window holds no point.
    """

    def __init__(
        self, system: System, times: Tensor, windows: Mapping[str, Sequence[float]], angles: Sequence[str] = ()
    ) -> None:
        if len(system.state_shape) != 1:
            problem = f"{type(system).__name__} has states of shape {system.state_shape}"
            raise InputError(
                "model.encoder.windows", problem, "windows are of plain states; choose an encoder of fields"
            )
        # In an order of their own: a mapping that says the same in another order is the same encoder.
        self.points = [(*_select(system, name, windows[name], times), name in angles) for name in sorted(windows)]
        self.values = sum(len(points) for _, points, _ in self.points)
        self.inputs = sum(3 * len(points) - 1 if angle else len(points) for _, points, angle in self.points)

    def __call__(self, observed: Tensor) -> Tensor:
        columns = [
            observed[..., component].index_select(0, constant_like(observed, points, torch.long))
            for component, points, _ in self.points
        ]
        return torch.cat(columns).movedim(0, -1)

    def features(self, seen: Tensor) -> Tensor:
        """(…, B, values) → (…, B, inputs)."""
        columns = []
        parts = seen.split([len(points) for _, points, _ in self.points], dim=-1)
        for value, (_, _, angle) in zip(parts, self.points, strict=True):
            columns += [torch.sin(value), torch.cos(value), torch.sin(value.diff(dim=-1))] if angle else [value]
        return torch.cat(columns, dim=-1)


def _select(system: System, name: str, window: Sequence[float], times: Tensor) -> tuple[int, list[int]]:
    """Index of a component and of its points."""
    names = [p.name for p in system.state]
    if name not in names:
        raise InputError(f"model.encoder.windows.{name}", "unknown", f"components: {', '.join(names)}")
    where = f"model.encoder.windows.{name}"
    first, last = window
    if last > float(times[-1]) + 1.5 * float(times[-1] - times[-2]):  # a last point may be left out
        raise InputError(where, f"[{first}, {last}] s", f"the encoder sees 0 to {float(times[-1]):g} s")
    inside = [k for k, t in enumerate(times.tolist()) if first - 1e-9 <= t <= last + 1e-9]
    if not inside:
        raise InputError(where, f"[{first}, {last}] s", f"choose within 0 to {float(times[-1]):g} s")
    return names.index(name), sorted({0, *inside})


@configure_by(WindowSettings)
class WindowEncoder(nn.Module):
    """MLP over windows of chosen components (paper, appendix, double pendulum).

    Inputs (:class:`ComponentView`) are standardised by the training set, each on its own: a full whitening blows up
    what the training set hardly varies, and an augmented sample then lies thousands of units away.

    Arguments:
        times: of the observed window in s, (T1,).
    """

    stackable = True
    head_prefix = "head."

    def __init__(self, system: System, times: Tensor, **options: Any) -> None:
        super().__init__()
        own = WindowSettings.of(**options)
        self.system = system
        self.latent = own.latent
        self.window = ComponentView(system, times, own.windows, own.angles)
        inputs = self.window.inputs
        self.scale = Standardise(inputs)
        self.trunk = MLP(inputs, own.layers[:-1], own.layers[-1], own.activation)
        self.head = MLP(own.layers[-1], (), len(system.expert_parameters))
        self.latent_head = MLP(own.layers[-1], (), own.latent)
        self.skip = Linear(inputs, len(system.expert_parameters), bias=False) if own.skip else None

    def inputs(self, observed: Tensor) -> Tensor:
        """(T1, …, B, *state) → (…, B, inputs)."""
        return self.window.features(self.window(observed))

    def fit(self, observed: Tensor) -> None:
        """Standardise by the training set's observed window (T1, N, *state)."""
        self.scale.fit(self.inputs(observed))

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, *state) → z_e (…, B, P), z_a (…, B, latent)."""
        x = self.scale(self.inputs(observed))
        hidden = self.trunk.activation(self.trunk(x))
        raw = self.head(hidden) if self.skip is None else self.head(hidden) + self.skip(x)
        return Posterior(Delta(constrain(raw, self.system.expert_parameters)), Delta(self.latent_head(hidden)))
