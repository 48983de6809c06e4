"""Decoders: what forecasts from estimates, whoever made them.

dy/dt = F_e(y; z_e) + F_a(y; z_a), the equation that made simulated data, and the mean of the training signals."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import torch
from torch import Tensor, nn
from torch.nn import functional

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction
from expertaug.models.posterior import Estimates, Predictor
from expertaug.models.sensors import Sensors
from expertaug.models.settings import MARGIN
from expertaug.systems import System
from expertaug.systems.inputs import solve
from expertaug.systems.solvers.adjoint import Part, solve_with_adjoint, sum_of, takes_adjoint
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows


def _repeated(z: Tensor, times: int) -> Tensor:
    """Values (…, B, Q) of samples, each so many times in turn, (…, B·times, Q)."""
    return z if times == 1 else z.unsqueeze(-2).expand(*z.shape[:-1], times, -1).flatten(-3, -2)


class LatentBound(nn.Module):
    """z_a as F_a sees it: as it is within the range of the training windows', and beyond it ever less far, at most a
    tenth of the range.

    F_a has learned nothing there, and an encoder that reads a z_a far outside would let it drive the motion.

    Arguments:
        least, most: ends of the range, (S, 1, Q).
    """

    least: Tensor
    most: Tensor

    def __init__(self, least: Tensor, most: Tensor) -> None:
        super().__init__()
        self.register_buffer("least", least)
        self.register_buffer("most", most)

    def forward(self, z_a: Tensor) -> Tensor:
        """z_a (S, B, Q), or (…, S, B, Q) → the same shape."""
        margin = MARGIN * (self.most - self.least).clamp_min(1e-6)
        inside = z_a.clamp(self.least, self.most)
        return inside + margin * torch.tanh((z_a - inside) / margin)


class Decoder(nn.Module):
    """A system's expert and an interaction model; it never sees an observed window.

    Arguments:
        system: gives F_e.
        interaction: F_a, or None for the expert alone.
        expert: False takes F_e away and keeps the system's kinematics: the agnostic neural ODE.
        likelihood: p(y | forecast), where the objective learns one.

    Attributes:
        latent_bound: of the z_a that F_a sees; None: it sees every z_a as it is.
        sensors: by which forecasts are what is measured, while they start from a state; None: the state is measured.

    Raises:
        InputError: a system with events without its expert, who alone knows them.
    """

    def __init__(
        self,
        system: System,
        interaction: nn.Module | None = None,
        expert: bool = True,
        likelihood: nn.Module | None = None,
    ) -> None:
        super().__init__()
        if system.has_events and not expert:
            problem = f"{type(system).__name__} has events, which are the expert's"
            raise InputError("expert", problem, "leave methods without an expert out")
        self.system = system
        self.interaction = interaction
        self.expert = expert
        self.likelihood = likelihood
        self.latent_bound: LatentBound | None = None
        self.sensors: Sensors | None = None

    def seen_by(self, sensors: Sensors | None) -> Decoder:
        """The same decoder, with the same tensors, whose forecasts sensors show."""
        if sensors is None:
            return self
        seen = copy.copy(self)
        seen.sensors = sensors
        return seen

    def measured(self, states: Tensor) -> Tensor:
        """States (…, *state) → what is measured of them."""
        return states if self.sensors is None else self.sensors.measured(states)

    def state_of(self, measured: Tensor) -> Tensor:
        """What is measured (…, *observed) → states, as a forecast starts from."""
        return measured if self.sensors is None else self.sensors.state(measured)

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

    def forecast(
        self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver, u: Tensor | None = None
    ) -> Tensor:
        """States (T, …, B, *state) at the times t (T,), from the known first point y0 (…, B, *state), as they are
        measured.

        Samples beyond those of z_a follow the expert alone: one solve for both costs less than two.

        Arguments:
            u: known inputs (T, …, B, U) at the times t; None for a system without.
        """
        count, axis = z_a.shape[-2], -1 - len(self.system.state_shape)
        context = self.context(z_a, z_e[..., :count, :])
        rest = y0.shape[axis] - count

        def parts_of(times: int = 1) -> list[Part]:
            """dy/dt of so many states of each sample in turn."""
            several = None if context is None else _repeated(context, times)
            return self._parts(_repeated(z_e, times), several, rest * times, solver)

        start, parts = self.system.initial_state(y0, z_e), parts_of()
        if self._takes_adjoint(solver, start, z_e, context):
            return self.measured(solve_with_adjoint(solver, parts, parts_of, start, t))
        flow = partial(self.system.linear_flow, z_e) if self.expert and solver.splits else None
        return self.measured(solve(self.system, sum_of(parts), start, t, solver, z_e, u, flow))

    def _parts(self, z_e: Tensor, context: Tensor | None, rest: int, solver: Solver) -> list[Part]:
        """What dy/dt is a sum of, at a time and states (…, B, *state), and known inputs and the side where the system
        has them: F_e, and F_a where there is one.

        Arguments:
            z_e: (…, B, P).
            context: what F_a prepared, of the first samples; None without an F_a.
            rest: how many samples after them follow the expert alone.
        """
        system, every = self.system, range(len(self.system.state))
        law = system.nonlinear if solver.splits else system.expert

        def expert(s: Tensor, y: Tensor, *more: Tensor) -> Tensor:
            return law(s, y, z_e, *more) if self.expert else system.kinematics(y)

        if context is None:
            return [Part(expert, every)]
        count, axis, interaction = context.shape[-2], -1 - len(system.state_shape), self.interaction
        driven, events, added = bool(system.known), system.has_events, self._along(context)
        linear = interaction.linearised(context) if isinstance(interaction, Interaction) else None

        def given(s: Tensor, y: Tensor, more: Sequence[Tensor]) -> list[Tensor]:
            first = y if rest == 0 else y.narrow(axis, 0, count)
            s = s if s.dim() == 0 else s[..., :count]
            return [first, *self._seen(first, s, *(u[..., :count, :] for u in more[:driven]))]

        def padded(rate: Tensor) -> Tensor:
            return rate if rest == 0 else functional.pad(rate, (0, 0) * (-1 - axis) + (0, rest))

        def learned(s: Tensor, y: Tensor, *more: Tensor) -> Tensor:
            rate = added(*given(s, y, more))
            if events:  # what stays on an event follows the expert's law there
                rate = torch.where(more[-1][..., :count].unsqueeze(-1) == 0, 0.0, rate)
            return padded(rate)

        def linearised(s: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
            assert linear is not None
            rate, slopes = linear(*given(s, y, ()))
            return padded(rate), padded(slopes)

        components = getattr(interaction, "acts_on", every)
        return [Part(expert, every), Part(learned, components, None if linear is None else linearised)]

    def _takes_adjoint(self, solver: Solver, y0: Tensor, z_e: Tensor, context: Tensor | None) -> bool:
        """Whether a solve needs a gradient, and has it without a graph of its steps."""
        system, interaction = self.system, self.interaction
        own = interaction is None or isinstance(interaction, Interaction)
        if not (own and torch.is_grad_enabled()) or system.known or system.has_events or len(system.state_shape) > 1:
            return False
        if solver.splits and type(system).linear_flow is not System.linear_flow:
            return False
        given = [x for x in (y0, z_e, context) if x is not None]
        if any(x.dtype != y0.dtype for x in given):
            return False
        parameters = () if interaction is None else interaction.parameters()
        width = 0 if interaction is None else interaction.width
        return any(x.requires_grad for x in (*given, *parameters)) and takes_adjoint(solver, y0, width)

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor | None:
        """What F_a prepares for trajectories; None without an F_a."""
        if self.interaction is None:
            return None
        return self.interaction.context(z_a if self.latent_bound is None else self.latent_bound(z_a), z_e)

    def interaction_rate(self, y: Tensor, context: Tensor, s: Tensor, u: Tensor | None = None) -> Tensor:
        """F_a at states y (…, B, *state), in their shape.

        Arguments:
            context: what F_a prepared for these trajectories, (…, B, width).
            s: time in s, one or (…, B).
            u: known inputs (…, B, U) then.
        """
        return self._along(context)(y, *self._seen(y, s, *(() if u is None else (u,))))

    def _along(self, context: Tensor) -> Callable[..., Tensor]:
        """F_a of states, and of what it sees besides, for one context."""
        if isinstance(self.interaction, Interaction):
            return self.interaction.along(context)
        return lambda y, *known: self.interaction(y, context, *known)  # type: ignore[misc]

    def _seen(self, y: Tensor, s: Tensor, u: Tensor | None = None) -> list[Tensor]:
        """What F_a sees besides states y (…, B, *state): known inputs (…, B, U), the time s, or nothing."""
        seen = [u] if u is not None and getattr(self.interaction, "sees_inputs", False) else []
        if getattr(self.interaction, "sees_time", False):
            when = torch.as_tensor(s, dtype=y.dtype).to(y.device, non_blocking=True)
            seen.append(when.expand(y.shape[: y.dim() - len(self.system.state_shape)]).unsqueeze(-1))
        return [torch.cat(seen, dim=-1)] if seen else []

    def interaction_squares(
        self, y: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor | None = None, u: Tensor | None = None
    ) -> Tensor:
        """Mean over the state's dimensions of F_a² at every point, (…, B·T): for y (T, …, B, *state),
        z_e (…, B, P) and z_a (…, B, Q).

        Arguments:
            t: times (T,), where F_a sees them.
            u: known inputs (T, …, B, U), where F_a sees them.

        Raises:
            AttributeError: there is no interaction model.
        """
        state = self.system.state_shape
        points = y.movedim(0, -1 - len(state)).flatten(-2 - len(state), -1 - len(state))  # (…, B·T, *state)
        context = self.context(z_a, z_e).repeat_interleave(len(y), dim=-2)
        if t is None:
            times = y.new_zeros(())
        else:
            t = t.to(y.device, non_blocking=True)
            times = t.expand(*y.shape[1 : y.dim() - len(state)], -1).flatten(-2)
        inputs = () if u is None else (u.movedim(0, -2).flatten(-3, -2),)
        rates = self.interaction_rate(points, context, times, *inputs)
        return rates.square().flatten(-len(state)).mean(-1)


class TruthDecoder(Decoder):
    """The equation that made simulated data, with z_a its own interaction parameters: a floor for what learns it."""

    def forecast(
        self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver, u: Tensor | None = None
    ) -> Tensor:
        """As :meth:`Decoder.forecast`; z_a (…, B, Q) in its units."""
        system, flow = self.system, None
        if solver.splits:
            flow = partial(system.linear_flow, z_e)

        def field(s: Tensor, y: Tensor, *more: Tensor) -> Tensor:
            rate = system.truth(s, y, z_e, z_a, *more)
            if not solver.splits:
                return rate
            # The solver has the linear part by itself.
            return rate - (system.expert(s, y, z_e, *more) - system.nonlinear(s, y, z_e, *more))

        return self.measured(solve(system, field, system.initial_state(y0, z_e), t, solver, z_e, u, flow))


class MeanModel(Predictor, nn.Module):
    """A decoder that needs no estimates: for every time the training set's mean state.

    Arguments:
        mean: (T, *state).
    """

    def __init__(self, system: System, mean: Tensor) -> None:
        super().__init__()
        self.system = system
        self.register_buffer("mean", mean)

    def estimate(self, windows: Windows) -> Estimates:
        """Observed windows → their first points, and no parameters."""
        return Estimates(windows.y[0].nan_to_num(), None, None)

    def forecast(self, y0: Tensor, z_e: None, z_a: None, t: Tensor, solver: Solver, u: Tensor | None = None) -> Tensor:
        """(…, B, *state) → (T, …, B, *state); the same for every sample, and beyond the training's times that
        of the last of them."""
        last = len(self.mean) - 1
        means = self.mean[torch.arange(len(t)).clamp_max(last)]
        lead = y0.dim() - self.mean.dim() + 1
        mean = means.reshape(len(t), *[1] * lead, *self.mean.shape[1:])
        return mean.expand(len(t), *y0.shape)
