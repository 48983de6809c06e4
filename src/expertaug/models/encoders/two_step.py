"""The hybrid-VAE's two-step encoder: q(z_a | x, y) and q(z_e | x, y, z_a) (Takeishi and Kalousis 2021).

g_a reads z_a off the observation, g_p1 filters the observation so that the expert alone could have made it, and g_p2
reads z_e off what is left, the same network that the objective trains on the expert's own simulations (the paper's
appendix on the hybrid-VAE).  :class:`MLPTwoStep` is for vectors, :class:`ConvTwoStep` for fields.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from math import prod
from typing import Any

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.encoders.fields import Moments
from expertaug.models.encoders.window import ComponentView, StateView
from expertaug.models.networks.convolutional import (
    Conv,
    StandardiseChannels,
    UNet,
    differences,
    grid_rank,
    layer_averages,
)
from expertaug.models.networks.layers import MLP, Linear, Standardise, feature_count
from expertaug.models.posterior import Gaussian, Normal, Posterior, bound_log_std
from expertaug.models.settings import ConvTwoStepSettings, TwoStepSettings, configure_by
from expertaug.systems import System


class TwoStep(nn.Module):
    """The two-step encoder over three networks.

    Arguments:
        view: of the observed window, (T1, …, B, *state) → (…, B, *seen).
        latent: size Q of z_a.
        latent_network: g_a, (…, B, *seen) → (…, B, 2 Q).
        filter_network: g_p1, (…, B, *seen) and z_a (…, B, Q) → (…, B, *seen).
        expert_network: g_p2, (…, B, *seen) → (…, B, 2 P).

    Every network has ``fit``, which sees the training set's view (N, *seen) once, before training.
    """

    stackable = True
    head_prefix = "expert_network."

    def __init__(
        self,
        system: System,
        view: Callable[[Tensor], Tensor],
        latent: int,
        latent_network: nn.Module,
        filter_network: nn.Module,
        expert_network: nn.Module,
    ) -> None:
        super().__init__()
        self.system, self.view, self.latent = system, view, latent
        self.latent_network, self.filter_network = latent_network, filter_network
        self.expert_network = expert_network

    def fit(self, observed: Tensor) -> None:
        """Standardise by the training set's observed window (T1, N, *state)."""
        seen = self.view(observed)
        for network in (self.latent_network, self.filter_network, self.expert_network):
            network.fit(seen)  # type: ignore[operator]

    def infer(self, seen: Tensor) -> Gaussian:
        """g_p2: q(z_e) of (…, B, *seen), the view of what the expert alone has made or could have."""
        return _gaussian(self.expert_network(seen), self.system.expert_parameters)

    def forward(self, observed: Tensor, normal: Normal | None = None) -> Posterior:
        """(T1, …, B, *state) → q(z_a), and q(z_e) given a sample of it by ``normal``; given its mean without."""
        seen = self.view(observed)
        z_a = _gaussian(self.latent_network(seen))
        used = z_a.mean if normal is None else z_a.draw(normal)
        filtered = self.filter_network(seen, used)
        return Posterior(self.infer(filtered), z_a, used, filtered)


@configure_by(TwoStepSettings)
class MLPTwoStep(TwoStep):
    """Fully connected g_a, g_p1 and g_p2 (paper, app. HVAE, pendulum and RLC).

    Over the observed states g_p1 is one MLP for all time steps; over windows of components, which have no common time
    steps, one MLP for all of them.  Either gives what is to be added to the observation, so that an untrained g_p1
    hardly changes it.

    Arguments:
        times: of the observed window in s, (T1,).
    """

    stackable = True

    def __init__(self, system: System, times: Tensor, **options: Any) -> None:
        own = TwoStepSettings.of(**options)
        parameters = len(system.expert_parameters)
        view: StateView | ComponentView
        if own.windows is None:
            view = StateView(system, times)
            step_filter: nn.Module = StepFilter(system, times, own.latent, own.filter_layers, own.activation)
        else:
            view = ComponentView(system, times, own.windows, own.angles)
            step_filter = WindowFilter(view, own.latent, own.filter_layers, own.activation)
        super().__init__(
            system,
            view,
            own.latent,
            ViewMLP(view, own.latent_layers, 2 * own.latent, own.activation),
            step_filter,
            ViewMLP(view, own.expert_layers, 2 * parameters, own.activation, own.skip),
        )


class ViewMLP(nn.Module):
    """MLP of a view's standardised features, (…, B, *seen) → (…, B, outputs): g_a or g_p2."""

    def __init__(
        self, view: StateView | ComponentView, layers: Sequence[int], outputs: int, activation: str, skip: bool = False
    ) -> None:
        super().__init__()
        self.features = view.features
        self.scale = Standardise(view.inputs)
        self.mlp = MLP(view.inputs, layers, outputs, activation)
        self.skip = Linear(view.inputs, outputs, bias=False) if skip else None

    def fit(self, seen: Tensor) -> None:
        self.scale.fit(self.features(seen))

    def forward(self, seen: Tensor) -> Tensor:
        x = self.scale(self.features(seen))
        return self.mlp(x) if self.skip is None else self.mlp(x) + self.skip(x)


class WindowFilter(nn.Module):
    """g_p1 over windows: (…, B, values) + MLP(their features, z_a)."""

    def __init__(self, view: ComponentView, latent: int, layers: Sequence[int], activation: str) -> None:
        super().__init__()
        self.features = view.features
        self.scale = Standardise(view.inputs)
        self.mlp = MLP(view.inputs + latent, layers, view.values, activation)

    def fit(self, seen: Tensor) -> None:
        self.scale.fit(self.features(seen))

    def forward(self, seen: Tensor, z_a: Tensor) -> Tensor:
        return seen + self.mlp(torch.cat((self.scale(self.features(seen)), z_a), dim=-1))


class StepFilter(nn.Module):
    """g_p1 over states: y_i + MLP(y_i, x, z_a, t_i), the MLP's output in units of the state's standard deviation.

    What the interaction has done by t_i depends on t_i, so the network is told.
    """

    unit: Tensor
    time: Tensor

    def __init__(self, system: System, times: Tensor, latent: int, layers: Sequence[int], activation: str) -> None:
        super().__init__()
        self.system = system
        inputs, values = feature_count(system, "model.encoder.kind"), prod(system.state_shape)
        self.scale = Standardise(inputs)
        self.register_buffer("unit", torch.ones(1, values))
        self.register_buffer("time", (2 * times / times[-1] - 1).to(torch.float32).unsqueeze(-1))
        self.state_layer = Linear(inputs, layers[0], bias=False)
        self.time_layer = Linear(1, layers[0], bias=False)
        self.known_layer = Linear(inputs + latent, layers[0])
        self.rest = MLP(layers[0], layers[1:], values, activation)

    def fit(self, seen: Tensor) -> None:
        self.scale.fit(self.system.features(seen).flatten(0, -2))
        values = seen.flatten(-len(self.system.state_shape))
        self.unit.copy_(values.flatten(0, -2).std(0, keepdim=True).expand_as(self.unit))

    def forward(self, seen: Tensor, z_a: Tensor) -> Tensor:
        shape = self.system.state_shape
        steps = seen.shape[-1 - len(shape)]
        x = self.scale(self.system.features(seen).flatten(-3, -2))  # (…, B·T1, inputs)
        first = x.unflatten(-2, (-1, steps))[..., 0, :]
        hidden = self.state_layer(x).unflatten(-2, (-1, steps))
        hidden = hidden + self.known_layer(torch.cat((first, z_a), dim=-1)).unsqueeze(-2)
        hidden = hidden + self.time_layer(self.time).unsqueeze(-3)
        added = self.rest(self.rest.activation(hidden.flatten(-3, -2)))
        return seen + (self.unit * added).unflatten(-2, (-1, steps)).unflatten(-1, shape)


def _gaussian(outputs: Tensor, parameters: Sequence | None = None) -> Gaussian:
    """Network outputs (…, 2 K) → K Gaussians."""
    loc, raw = outputs.chunk(2, dim=-1)
    return Gaussian(loc, bound_log_std(raw), parameters)


@configure_by(ConvTwoStepSettings)
class ConvTwoStep(TwoStep):
    """CNNs for g_a and g_p2, a conditional U-Net for g_p1 (paper, app. HVAE, reaction–diffusion).

    All frames enter as channels of one image: a tenth of the cost of one frame after the other, and g_p1, which has to
    take away what the interaction has done by each frame, knows which frame is which.

    With ``powers`` g_a and g_p2 are MLPs of ``layers`` on the frames'
    :class:`~expertaug.models.encoders.fields.Moments`.

    Arguments:
        times: of the observed window; their number is that of the frames.
    """

    stackable = True

    def __init__(self, system: System, times: Tensor, **options: Any) -> None:
        own = ConvTwoStepSettings.of(**options)
        rank, grid = grid_rank(system, "model.encoder.kind"), system.state_shape[1:]
        halvings = len(own.filter_channels) - 1
        if any(cells % 2**halvings for cells in grid):
            remedy = f"at most so many levels that the grid {grid} can be halved"
            raise InputError("model.encoder.filter_channels", str(list(own.filter_channels)), remedy)
        fields = len(times) * system.state_shape[0]

        def network(outputs: int) -> nn.Module:
            if own.powers is None:
                return FrameCNN(rank, fields, own.channels, own.strides, own.layers, outputs, system.periodic)
            return FrameMoments(system, len(times), own.powers, own.layers, outputs)

        latent_network, expert_network = network(2 * own.latent), network(2 * len(system.expert_parameters))
        filter_network = FrameFilter(rank, fields, own.latent, own.filter_channels, system.periodic)
        super().__init__(system, partial(frames, rank=rank), own.latent, latent_network, filter_network, expert_network)


def frames(observed: Tensor, rank: int) -> Tensor:
    """The view: (T1, …, B, fields, *grid) → (…, B, T1 · fields, *grid)."""
    return observed.movedim(0, -2 - rank).flatten(-2 - rank, -1 - rank)


class FrameCNN(nn.Module):
    """Frames and their Laplacians (…, B, frames, *grid) → (…, B, outputs): g_a or g_p2.

    Every layer is averaged over the grid, as :class:`expertaug.models.encoders.fields.ConvEncoder` does.
    """

    def __init__(
        self,
        rank: int,
        fields: int,
        channels: Sequence[int],
        strides: Sequence[int],
        layers: Sequence[int],
        outputs: int,
        periodic: bool,
    ) -> None:
        super().__init__()
        self.rank, self.periodic = rank, periodic
        self.scale = StandardiseChannels(2 * fields, rank)
        self.layers = nn.ModuleList(
            Conv(rank, a, b, stride=s) for (a, b), s in zip(pairwise((2 * fields, *channels)), strides, strict=True)
        )
        self.head = MLP(sum(channels), layers, outputs)

    def fit(self, seen: Tensor) -> None:
        self.scale.fit(self._with_differences(seen))

    def forward(self, seen: Tensor) -> Tensor:
        x = self.scale(self._with_differences(seen))
        return self.head(layer_averages(self.layers, x, self.periodic))

    def _with_differences(self, seen: Tensor) -> Tensor:
        return torch.cat((seen, differences(seen, self.rank, self.periodic)), dim=-1 - self.rank)


class FrameMoments(nn.Module):
    """MLP on the frames' moments, (…, B, frames, *grid) → (…, B, outputs): g_a or g_p2."""

    def __init__(self, system: System, frames: int, powers: Sequence[int], layers: Sequence[int], outputs: int) -> None:
        super().__init__()
        self.moments = Moments(system, frames, powers)
        self.head = MLP(self.moments.outputs, layers, outputs, "silu")

    def fit(self, seen: Tensor) -> None:
        self.moments.fit(self._frames(seen))

    def forward(self, seen: Tensor) -> Tensor:
        return self.head(self.moments(self._frames(seen)))

    def _frames(self, seen: Tensor) -> Tensor:
        return seen.unflatten(-1 - self.moments.rank, (-1, self.moments.fields))


class FrameFilter(nn.Module):
    """g_p1: frames + U-Net(frames, z_a), the U-Net's output in units of each frame's standard deviation."""

    def __init__(self, rank: int, fields: int, latent: int, channels: Sequence[int], periodic: bool) -> None:
        super().__init__()
        self.scale = StandardiseChannels(fields, rank)
        self.network = UNet(fields, latent, channels, rank, periodic)

    def fit(self, seen: Tensor) -> None:
        self.scale.fit(seen)

    def forward(self, seen: Tensor, z_a: Tensor) -> Tensor:
        return seen + self.scale.std.unsqueeze(-2 - self.scale.rank) * self.network(self.scale(seen), z_a)
