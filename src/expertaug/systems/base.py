"""What a physical system is to the rest of the package."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any, Literal

import torch
from torch import Tensor

from expertaug.systems.solvers.solver import Solver


@dataclass(frozen=True)
class Parameter:
    """A named scalar of a system.

    Attributes:
        name: as in config files and tables.
        unit: SI text; empty for a pure number.
        positive: whether estimates are kept positive by construction.
        scale: typical magnitude in that unit; estimates of an untrained encoder are of this size.
    """

    name: str
    unit: str = ""
    positive: bool = True
    scale: float = 1.0


def constant_like(like: Tensor, values: Sequence[float] | Sequence[bool] | Sequence[int], dtype: torch.dtype) -> Tensor:
    """Constants (K,) of a type, where the tensor ``like`` lies; sent to a card without waiting for it, which
    ``Tensor.new_tensor`` would."""
    # Not kept for the next call: one made within torch.func or inference mode cannot be used outside.
    return torch.tensor(values, dtype=dtype).to(like.device, non_blocking=True)


class System(ABC):
    """One physical system dy/dt = F_e(t, y; z_e) + F_a(t, y; z_a) (paper, equation generic_ode).

    A subclass in a module of its own is all that a new system needs: the config names the module.  All arrays are torch
    tensors whose leading axes broadcast; (…) below stands for them.

    Attributes:
        state: name and unit of each component (``positive`` and ``scale`` are not used).
        expert_parameters: the components of z_e, in order.
        interaction_parameters: the components of the true z_a in simulations; empty where there is no simulation.
        simulation: how simulations are solved.
        inputs: known inputs u(t) of each trajectory (a force, a voltage), in order; with any, ``expert`` and ``truth``
            have one argument more: u (…, U) at the time asked for, the covariates last.
        covariates: known numbers that are constant along a trajectory; the last components of u.
        interpolation: of the inputs between the times of the data: linear, or constant (the last value holds).
        input_parameters: what simulated inputs are drawn from, uniformly in ranges (:meth:`input_signal`).
        periodic: of fields, what convolutions find beyond an edge: the other end, or zero.
    """

    state: tuple[Parameter, ...]
    expert_parameters: tuple[Parameter, ...]
    interaction_parameters: tuple[Parameter, ...] = ()
    simulation: Solver = Solver("dopri5", rtol=1e-8, atol=1e-8)
    inputs: tuple[Parameter, ...] = ()
    covariates: tuple[Parameter, ...] = ()
    interpolation: Literal["linear", "constant"] = "linear"
    input_parameters: tuple[Parameter, ...] = ()
    periodic: bool = True
    _made_with: tuple[tuple, dict] = ((), {})

    def __init_subclass__(cls, **options: object) -> None:
        """Let instances remember what they were made with (:func:`expertaug.systems.describe`)."""
        super().__init_subclass__(**options)
        own = vars(cls).get("__init__")
        if own is None:
            return

        @wraps(own)
        def remembering(self: System, *arguments: object, **named: object) -> None:
            if "_made_with" not in vars(self):
                self._made_with = (arguments, named)
            own(self, *arguments, **named)

        setattr(cls, "__init__", remembering)  # noqa: B010 (an assignment would hide the signature from type checkers)

    @property
    def state_shape(self) -> tuple[int, ...]:
        """Shape of one state."""
        return (len(self.state),)

    @property
    def known(self) -> tuple[Parameter, ...]:
        """The components of u: inputs, then covariates."""
        return (*self.inputs, *self.covariates)

    @property
    def angles(self) -> tuple[str, ...]:
        """Names of the state's components that are angles, of which an equation has sines and cosines: those in rad."""
        return tuple(p.name for p in self.state if p.unit == "rad")

    # A subclass with known inputs has u (…, U) as last argument of the methods that have *u here; another has not.
    @abstractmethod
    def expert(self, t: Tensor, y: Tensor, z_e: Tensor, *u: Any, **none: Any) -> Tensor:
        """F_e: time derivative (…, *state) at states y (…, *state) for parameters z_e (…, P)."""

    @property
    def has_events(self) -> bool:
        """Whether :meth:`event` is defined; ``expert`` and ``truth`` then have the side as last argument."""
        return type(self).event is not System.event

    def event(self, y: Tensor, z_e: Tensor) -> Tensor:
        """A number (…) that changes its sign where something happens, of states y (…, *state).

        The law on either side is a smooth one, which may go on beyond the event: ``expert`` and ``truth`` are told by
        ``side`` (…) on which they are, 1 or −1 as this number, or 0 for what stays on it.
        """
        raise NotImplementedError

    def jump(self, y: Tensor, z_e: Tensor) -> Tensor:
        """States after an event, (…, *state), of those at it: the event's number is 0 there, or of another sign."""
        return y

    def linear_flow(self, z_e: Tensor, h: float) -> Callable[[Tensor], Tensor] | None:
        """y (…, *state) → exp(h L) y, the exact flow of a linear part L of F_e; None where there is none.

        Such a part may be stiff: the solvers lawson4, ab4 and ab5 have it exact, and ask :meth:`nonlinear` for the
        rest. Where L is diagonal in a basis, give a :class:`~expertaug.DiagonalPropagator`.
        """
        return None

    def nonlinear(self, t: Tensor, y: Tensor, z_e: Tensor, *u: Any, **none: Any) -> Tensor:
        """F_e without the part that :meth:`linear_flow` solves."""
        return self.expert(t, y, z_e, *u)

    def truth(self, t: Tensor, y: Tensor, z_e: Tensor, z_a: Tensor, *u: Any, **none: Any) -> Tensor:
        """The full right-hand side that simulations follow: (…, *state) for z_a (…, Q)."""
        raise NotImplementedError(f"{type(self).__name__} has no simulation: its data come from recordings")

    def sample_initial_state(self, n: int, generator: torch.Generator) -> Tensor:
        """n initial states of the simulation, (n, *state), float64."""
        raise NotImplementedError(f"{type(self).__name__} has no simulation: its data come from recordings")

    def input_signal(self, t: Tensor, parameters: Tensor) -> Tensor:
        """Simulated inputs (n, T, inputs) at the times t (T,) of parameters (n, K), those of ``input_parameters``."""
        if self.inputs:
            raise NotImplementedError(f"{type(self).__name__} draws no inputs: give them, u (n, T, {len(self.known)})")
        return parameters.new_zeros(len(parameters), len(t), 0)

    def energy(self, y: Tensor, z_e: Tensor) -> Tensor:
        """What the expert conserves, (…,): a study compares its loss with what F_a dissipates."""
        raise NotImplementedError(f"{type(self).__name__} has no energy")

    def kinematics(self, y: Tensor) -> Tensor:
        """What stays of the right-hand side when the expert is taken away, (…, *state): nothing, unless overridden."""
        return torch.zeros_like(y)

    def initial_state(self, y0: Tensor, z_e: Tensor) -> Tensor:
        """The state (…, *state) in which a forecast starts, from the known first point y0 and z_e (…, P)."""
        return y0

    def resample_known(self, y0: Tensor, uniform: Callable[[int], Tensor]) -> Tensor:
        """First points y0 (…, *state) with x drawn anew: unchanged, unless overridden.

        ``uniform(k)`` gives (…, k) numbers, uniform in [0, 1).
        """
        return y0

    def observe(self, y: Tensor) -> Tensor:
        """The quantities (…, *observed) whose squared error is loss and metric: the state, unless overridden."""
        return y

    @property
    def error_dims(self) -> int:
        """By what the summed squared error is divided in the per-dimension convention: the numbers observed."""
        return self.observe(torch.zeros(self.state_shape)).numel()

    def features(self, y: Tensor) -> Tensor:
        """States as networks see them, (…, features): the state, unless overridden."""
        return y
