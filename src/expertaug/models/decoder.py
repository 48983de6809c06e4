"""The decoder dy/dt = F_e(y; z_e) + F_a(y; z_a): what forecasts from estimates, whoever made them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import torch
from torch import Tensor, nn

from expertaug.systems import System
from expertaug.systems.solver import Solver


class Decoder(nn.Module):
    """A system's expert and an interaction model; it never sees an observed window.

    Arguments:
        system: gives F_e.
        interaction: F_a, or None for the expert alone.
        expert: False takes F_e away and keeps the system's kinematics: the agnostic neural ODE.
        likelihood: p(y | forecast), where the objective learns one.
    """

    def __init__(
        self,
        system: System,
        interaction: nn.Module | None = None,
        expert: bool = True,
        likelihood: nn.Module | None = None,
    ) -> None:
        super().__init__()
        self.system = system
        self.interaction = interaction
        self.expert = expert
        self.likelihood = likelihood

    @property
    def knows_z_e(self) -> bool:
        """Whether z_e means the expert's parameters: without F_e nothing asks for them, but a start that they give."""
        return self.expert or type(self.system).initial_state is not System.initial_state

    def fit(self, observed: Tensor) -> None:
        """Let the parts that learn scales from the training set's observed window (T1, N, *state) do so."""
        if self.interaction is not None:
            self.interaction.fit(observed)
        if self.likelihood is not None:
            self.likelihood.fit(self.system.observe(observed))

    @contextmanager
    def expert_alone(self) -> Iterator[None]:
        """A context without the interaction model."""
        kept, self.interaction = self.interaction, None
        try:
            yield
        finally:
            self.interaction = kept

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

        return solver(field, self.system.initial_state(y0, z_e), t, flow, len(self.system.state_shape))

    def interaction_squares(self, y: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        """Mean over the state's dimensions of F_a² at every point, (…, B·T): for y (T, …, B, *state),
        z_e (…, B, P) and z_a (…, B, Q).

        Raises:
            AttributeError: there is no interaction model.
        """
        state = self.system.state_shape
        points = y.movedim(0, -1 - len(state)).flatten(-2 - len(state), -1 - len(state))  # (…, B·T, *state)
        context = self.interaction.context(z_a, z_e).repeat_interleave(len(y), dim=-2)
        return self.interaction(points, context).square().flatten(-len(state)).mean(-1)


class TruthDecoder(Decoder):
    """The equation that made simulated data, with z_a its own interaction parameters: a floor for what learns it."""

    def forecast(self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver) -> Tensor:
        """As :meth:`Decoder.forecast`; z_a (…, B, Q) in its units."""
        system, flow = self.system, None
        if solver.splits:
            flow = partial(system.linear_flow, z_e)

        def field(s: Tensor, y: Tensor) -> Tensor:
            rate = system.truth(s, y, z_e, z_a)
            # The solver has the linear part by itself.
            return rate - (system.expert(s, y, z_e) - system.nonlinear(s, y, z_e)) if solver.splits else rate

        return solver(field, system.initial_state(y0, z_e), t, flow, len(system.state_shape))
