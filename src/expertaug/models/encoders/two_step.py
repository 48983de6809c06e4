"""The hybrid-VAE's two-step encoder: q(z_a | x, y) and q(z_e | x, y, z_a) (Takeishi and Kalousis 2021).

g_a reads z_a off the observation, g_p1 filters the observation so that the expert alone could have made it, and g_p2
reads z_e off what is left, the same network that the objective trains on the expert's own simulations (the paper's
appendix on the hybrid-VAE).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import torch
from torch import Tensor, nn

from expertaug.models.encoders.views import States, Windows
from expertaug.models.networks.layers import MLP, Linear, Standardise, feature_count
from expertaug.models.posterior import Gaussian, Normal, Posterior
from expertaug.systems import System

LOG_STD, SPREAD = -3.0, 4.0  # standard deviations begin near e⁻³ and stay within e⁻⁷ and e


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


class MLPTwoStep(TwoStep):
    """Fully connected g_a, g_p1 and g_p2 (paper, app. HVAE, pendulum and RLC).

    Over the observed states g_p1 is one MLP for all time steps; over windows of components, which have no common time
    steps, one MLP for all of them.  Either gives what is to be added to the observation, so that an untrained g_p1
    hardly changes it.

    Arguments:
        latent: size of z_a.
        latent_layers, filter_layers, expert_layers: hidden layers of g_a, g_p1 and g_p2.
        windows, angles: what the encoder sees, as :class:`expertaug.models.encoders.views.Windows` has it; null for all
            states.
        skip: whether a linear map of the inputs is added to g_p2's output.
        activation: of all three.
    """

    stackable = True

    def __init__(
        self,
        system: System,
        times: Tensor,
        latent: int = 1,
        latent_layers: Sequence[int] = (256, 256, 128, 32),
        filter_layers: Sequence[int] = (128, 128),
        expert_layers: Sequence[int] = (128, 128, 256, 64, 32),
        windows: Mapping[str, Sequence[float]] | None = None,
        angles: Sequence[str] = (),
        skip: bool = False,
        activation: str = "selu",
    ) -> None:
        parameters = len(system.expert_parameters)
        view: States | Windows
        if windows is None:
            view = States(system, times)
            step_filter: nn.Module = StepFilter(system, times, latent, filter_layers, activation)
        else:
            view = Windows(system, times, windows, angles)
            step_filter = WindowFilter(view, latent, filter_layers, activation)
        super().__init__(
            system,
            view,
            latent,
            ViewMLP(view, latent_layers, 2 * latent, activation),
            step_filter,
            ViewMLP(view, expert_layers, 2 * parameters, activation, skip),
        )


class ViewMLP(nn.Module):
    """MLP of a view's standardised features, (…, B, *seen) → (…, B, outputs): g_a or g_p2."""

    def __init__(
        self, view: States | Windows, layers: Sequence[int], outputs: int, activation: str, skip: bool = False
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

    def __init__(self, view: Windows, latent: int, layers: Sequence[int], activation: str) -> None:
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
        inputs = feature_count(system, "model.encoder.kind")
        self.scale = Standardise(inputs)
        self.register_buffer("unit", torch.ones(1, system.state_shape[-1]))
        self.register_buffer("time", (2 * times / times[-1] - 1).to(torch.float32).unsqueeze(-1))
        self.state_layer = Linear(inputs, layers[0], bias=False)
        self.time_layer = Linear(1, layers[0], bias=False)
        self.known_layer = Linear(inputs + latent, layers[0])
        self.rest = MLP(layers[0], layers[1:], system.state_shape[-1], activation)

    def fit(self, seen: Tensor) -> None:
        self.scale.fit(self.system.features(seen).flatten(0, -2))
        self.unit.copy_(seen.flatten(0, -2).std(0, keepdim=True).expand_as(self.unit))

    def forward(self, seen: Tensor, z_a: Tensor) -> Tensor:
        steps = seen.shape[-2]
        x = self.scale(self.system.features(seen).flatten(-3, -2))  # (…, B·T1, inputs)
        first = x.unflatten(-2, (-1, steps))[..., 0, :]
        hidden = self.state_layer(x).unflatten(-2, (-1, steps))
        hidden = hidden + self.known_layer(torch.cat((first, z_a), dim=-1)).unsqueeze(-2)
        hidden = hidden + self.time_layer(self.time).unsqueeze(-3)
        added = self.rest(self.rest.activation(hidden.flatten(-3, -2)))
        return seen + (self.unit * added).unflatten(-2, (-1, steps))


def _gaussian(outputs: Tensor, parameters: Sequence | None = None) -> Gaussian:
    """Network outputs (…, 2 K) → K Gaussians; the standard deviation is bounded smoothly on both sides."""
    loc, raw = outputs.chunk(2, dim=-1)
    return Gaussian(loc, LOG_STD + SPREAD * torch.tanh(raw / SPREAD), parameters)
