"""The hybrid model: an encoder and the decoder dy/dt = F_e(y; z_e) + F_a(y; z_a)."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from functools import partial

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.likelihood import GaussianLikelihood
from expertaug.models.posterior import Posterior
from expertaug.registry import find
from expertaug.systems import System
from expertaug.systems.solver import Solver


class HybridModel(nn.Module):
    """A system's expert, an interaction model and an encoder.

    Arguments:
        system: gives F_e.
        encoder: observed window → posterior.
        interaction: F_a, or None for the expert alone.
        expert: False takes F_e away and keeps the system's kinematics: the agnostic neural ODE.
        likelihood: p(y | forecast), where the objective learns one.
    """

    # Parameters of p_θ, which fine-tuning leaves alone, begin with one of these.
    decoder_prefixes = ("interaction.", "likelihood.")

    def __init__(
        self,
        system: System,
        encoder: nn.Module,
        interaction: nn.Module | None,
        expert: bool = True,
        likelihood: nn.Module | None = None,
    ) -> None:
        super().__init__()
        self.system = system
        self.encoder = encoder
        self.interaction = interaction
        self.expert = expert
        self.likelihood = likelihood

    def fit(self, observed: Tensor) -> None:
        """Let the parts that learn scales from the training set's observed window (T1, N, *state) do so."""
        self.encoder.fit(observed)
        if self.interaction is not None:
            self.interaction.fit(observed)
        if self.likelihood is not None:
            self.likelihood.fit(self.system.observe(observed))

    def encode(self, observed: Tensor) -> Posterior:
        """Observed window (T1, …, B, *state) → q(z_e, z_a)."""
        return self.encoder(observed)

    def forecast(self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver) -> Tensor:
        """States (T, …, B, *state) at the times t (T,), from the known first point y0 (…, B, *state).

        Samples beyond those of z_a follow the expert alone: one solve for both costs less than two.
        """
        count = z_a.shape[-2]
        context = self.interaction.context(z_a, z_e[..., :count, :]) if self.interaction is not None else None
        axis = -1 - len(self.system.state_shape)
        rest = y0.shape[axis] - count

        expert = self.system.nonlinear if solver.splits else self.system.expert
        flow = partial(self.system.linear_flow, z_e) if self.expert and solver.splits else None

        def field(s: Tensor, y: Tensor) -> Tensor:
            rate = expert(s, y, z_e) if self.expert else self.system.kinematics(y)
            if context is None:
                return rate
            if rest == 0:
                return rate + self.interaction(y, context)
            (first, _), (one, other) = y.split([count, rest], axis), rate.split([count, rest], axis)
            return torch.cat((one + self.interaction(first, context), other), axis)

        return solver(field, self.system.initial_state(y0, z_e), t, flow)

    def predict(self, observed: Tensor, t: Tensor, solver: Solver, start: str = "y0") -> tuple[Tensor, Tensor]:
        """Forecast from the posterior's mean.

        Arguments:
            observed: (T1, …, B, *state).
            t: (T,) in s, T ≥ T1.
            start: y0, or y_t1: integrate onwards from the last observed point and return the observation before it.

        Returns:
            states (T, …, B, *state) and the estimate of z_e (…, B, P).
        """
        z_e, z_a = self.encode(observed).mean
        if start == "y0":
            return self.forecast(observed[0], z_e, z_a, t, solver), z_e
        last = len(observed) - 1
        onwards = self.forecast(observed[last], z_e, z_a, t[last:], solver)
        return torch.cat((observed[:last], onwards)), z_e

    def interaction_squares(self, y: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        """Mean over the state's dimensions of F_a² at every point, (…, B·T): for y (T, …, B, *state),
        z_e (…, B, P) and z_a (…, B, Q).

        Raises:
            AttributeError: the model has no interaction model.
        """
        state = self.system.state_shape
        points = y.movedim(0, -1 - len(state)).flatten(-2 - len(state), -1 - len(state))  # (…, B·T, *state)
        context = self.interaction.context(z_a, z_e).repeat_interleave(len(y), dim=-2)
        return self.interaction(points, context).square().flatten(-len(state)).mean(-1)


def build(
    system: System,
    times: Tensor,
    model: Mapping,
    expert: bool = True,
    interaction: bool = True,
    likelihood: bool = False,
) -> HybridModel:
    """Make the model that a config's ``model`` block describes.

    Arguments:
        times: of the observed window in s, (T1,).
        model: ``encoder`` and ``interaction``, each with ``kind`` and its class's arguments.
        expert, interaction: False leaves that part out.
        likelihood: whether the objective learns a likelihood's scale.

    Raises:
        InputError: an unknown kind or argument.
    """
    encoder = _make("encoder", model["encoder"], system=system, times=times)
    part = _make("interaction", model["interaction"], system=system, latent=encoder.latent) if interaction else None
    return HybridModel(system, encoder, part, expert, GaussianLikelihood() if likelihood else None)


def _make(part: str, settings: Mapping, **fixed: object) -> nn.Module:
    arguments = dict(settings)
    kind = str(arguments.pop("kind", ""))
    cls = find(part, kind, f"model.{part}.kind")
    known = set(inspect.signature(cls).parameters) - set(fixed)
    for key in arguments:
        if key not in known:
            raise InputError(f"model.{part}.{key}", f"unknown to {kind}", f"known: {', '.join(sorted(known))}")
    return cls(**fixed, **arguments)


def stack(models: list[HybridModel]) -> HybridModel:
    """One model that computes a group of seeds: every parameter and buffer gains a leading seed axis."""
    stacked = models[0]
    tensors = [dict(m.named_parameters()) | dict(m.named_buffers()) for m in models]
    for name in list(tensors[0]):
        owner = stacked.get_submodule(name.rpartition(".")[0])
        leaf = name.rpartition(".")[2]
        value = torch.stack([t[name].detach() for t in tensors])
        if leaf in owner._parameters:
            owner._parameters[leaf] = nn.Parameter(value)
        else:
            owner._buffers[leaf] = value
    return stacked
