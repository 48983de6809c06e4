"""Encoders and interaction models written as ordinary PyTorch modules, as the rest of the package calls them.

An encoder is any module whose ``forward(observed)`` takes one seed's windows (T1, B, *state) and returns

- a tensor (B, P) or a tuple of tensors (B, P) and (B, Q), unbounded: z_e follows by
  :func:`~expertaug.models.posterior.constrain`, so that positive parameters are positive, and z_a is what it is; or
- a :class:`~expertaug.models.posterior.Posterior`.

Known inputs of the system are further components of the state there.

Q is the module's attribute ``latent``, 0 without it; ``head_prefix`` names the parameters of the z_e head alone.

An interaction model is any module whose ``forward(y, z_a)`` gives the rates of states y (B, *state) in their shape;
with a method ``context(z_a, z_e)``, called once a trajectory, ``forward`` is given its result (B, width) instead.  With
an attribute ``sees_inputs`` or ``sees_time`` that is true ``forward`` has a third argument: the known inputs (B, U),
with the time in s as a last component where that is seen.

Either may have ``fit(observed)``, which sees the training set's windows (T1, N, *state) once, before training; what it
learns belongs into buffers or parameters, which a model file keeps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn
from torch.distributions import Distribution

from expertaug.errors import InputError
from expertaug.models.posterior import Delta, Gaussian, Posterior, constrain
from expertaug.models.stacking import Parts, SeedWise, is_stackable
from expertaug.systems import System

Form = tuple[tuple[type[Distribution], object], ...]


def encoder_of(module: nn.Module, system: System) -> nn.Module:
    """The module itself where it is stackable, else wrapped."""
    return module if is_stackable(module) else UserEncoder(module, system)


def interaction_of(module: nn.Module, system: System) -> nn.Module:
    """The module itself where it is stackable, else wrapped."""
    return module if is_stackable(module) else UserInteraction(module, system)


class _UserModule(SeedWise):
    """What both share: where the seeds' axis is, and ``fit``."""

    def __init__(self, module: nn.Module, system: System, where: str) -> None:
        super().__init__(module, where)
        self.system = system

    def fit(self, observed: Tensor) -> None:
        """Let the module learn scales from the training set's observed window (T1, N, *state), where it does so."""
        if hasattr(self.module, "fit"):
            with torch.no_grad():
                self.each("fit", [observed], [None])

    def _axis(self, tensor: Tensor, alone: int, place: int = 0) -> int | None:
        """The seeds' axis of a tensor that has ``alone`` axes without one."""
        return place if tensor.dim() > alone else None


class UserEncoder(_UserModule):
    """An encoder from outside, as one for a group of seeds."""

    def __init__(self, module: nn.Module, system: System) -> None:
        super().__init__(module, system, "model.encoder")

    @property
    def latent(self) -> int:
        """Size of z_a."""
        return int(getattr(self.module, "latent", 0))

    @property
    def head_prefix(self) -> str:
        """Parameters of the z_e head alone.

        Raises:
            InputError: the module does not name them.
        """
        own = getattr(self.module, "head_prefix", None)
        if not isinstance(own, str):
            raise InputError(self.where, f"{self.name} has no head_prefix", "let it name the z_e head's parameters")
        return f"module.{own}"

    def forward(self, observed: Tensor) -> Posterior:
        """(T1, …, B, *state) → q(z_e, z_a)."""
        forms: list[Form] = []

        def finish(result: object) -> Parts:
            form, tensors = self._taken_apart(result, observed.shape[-1 - len(self.system.state_shape)])
            forms.append(form)
            return tensors

        axis = self._axis(observed, 2 + len(self.system.state_shape), 1)
        tensors = self.each("forward", [observed], [axis], finish)
        (z_e, of_z_e), (z_a, of_z_a) = forms[0]
        return Posterior(
            _put_together(z_e, of_z_e, *tensors[:2]), _put_together(z_a, of_z_a, *tensors[2:4]), *tensors[4:]
        )

    def _taken_apart(self, result: object, samples: int) -> tuple[Form, Parts]:
        """One seed's result → kinds of both distributions, and tensors: two of each, z_a_used and filtered."""
        if isinstance(result, Posterior):
            parts = (result.z_e, result.z_a)
            for part in parts:
                if type(part) not in (Delta, Gaussian):
                    raise InputError(
                        self.where, f"{self.name} returns a {type(part).__name__}", "use Delta or Gaussian"
                    )
            self._check("z_e", result.z_e.mean, samples, len(self.system.expert_parameters))
            self._check("z_a", result.z_a.mean, samples, self.latent)
            return (
                tuple((type(part), getattr(part, "parameters", None)) for part in parts),
                (*_tensors(result.z_e), *_tensors(result.z_a), result.z_a_used, result.filtered),
            )
        z_e, *rest = result if isinstance(result, tuple) else (result,)
        if not isinstance(z_e, Tensor) or len(rest) > 1:
            raise InputError(
                self.where,
                f"{self.name} returns {type(result).__name__}",
                "return a tensor (B, P), a tuple (z_e, z_a) or a Posterior",
            )
        z_a = rest[0] if rest else z_e.new_zeros(samples, 0)
        self._check("z_e", z_e, samples, len(self.system.expert_parameters))
        self._check("z_a", z_a, samples, self.latent)
        bounded = constrain(z_e, self.system.expert_parameters)
        return ((Delta, None), (Delta, None)), (bounded, None, z_a, None, None, None)

    def _check(self, name: str, value: Tensor, samples: int, size: int) -> None:
        if tuple(value.shape) != (samples, size):
            says = "the module's attribute latent" if name == "z_a" else "one for each expert parameter"
            raise InputError(
                self.where,
                f"{self.name} gives {name} of shape {tuple(value.shape)} for {samples} windows",
                f"make it ({samples}, {size}): {says}",
            )


def _tensors(part: Distribution) -> tuple[Tensor, Tensor]:
    second = part.log_std if isinstance(part, Gaussian) else torch.as_tensor(part.scale).to(part.loc)
    return part.loc, second.expand_as(part.loc)


def _put_together(kind: type[Distribution], parameters: object, loc: Tensor, second: Tensor | None) -> Distribution:
    if kind is Gaussian:
        return Gaussian(loc, second, parameters)
    return Delta(loc) if second is None else Delta(loc, second)


class UserInteraction(_UserModule):
    """An interaction model from outside, as one for a group of seeds."""

    def __init__(self, module: nn.Module, system: System) -> None:
        super().__init__(module, system, "model.interaction")

    @property
    def sees_inputs(self) -> bool:
        return bool(getattr(self.module, "sees_inputs", False))

    @property
    def sees_time(self) -> bool:
        return bool(getattr(self.module, "sees_time", False))

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, Q) and z_e (…, B, P) → what :meth:`forward` is given of them, (…, B, width)."""
        if not hasattr(self.module, "context"):
            return z_a
        return self._one("context", [(z_a, 2), (z_e, 2)], lambda result: self._context(result, z_a.shape[-2]))

    def forward(self, y: Tensor, context: Tensor, *known: Tensor) -> Tensor:
        """F_a at states y (…, B, *state), the shape of y; ``known`` is one tensor (…, B, ·), where it sees more."""
        rank = len(self.system.state_shape)
        arguments = [(y, 1 + rank), (context, 2), *((tensor, 2) for tensor in known)]
        return self._one("forward", arguments, lambda result: self._rates(result, y.shape[-1 - rank :]))

    def _one(self, method: str, arguments: Sequence[tuple[Tensor, int]], finish: Callable) -> Tensor:
        """What a method gives for tensors with so many axes each without one of seeds."""
        axes = [self._axis(tensor, alone) for tensor, alone in arguments]
        return self.each(method, [tensor for tensor, _ in arguments], axes, lambda result: (finish(result),))[0]

    def _context(self, context: object, samples: int) -> Tensor:
        if not isinstance(context, Tensor) or context.dim() != 2 or len(context) != samples:
            raise InputError(self.where, f"{self.name}.context gives {_shape(context)}", f"make it ({samples}, width)")
        return context

    def _rates(self, rates: object, shape: torch.Size) -> Tensor:
        if not isinstance(rates, Tensor) or rates.shape != shape:
            raise InputError(
                self.where, f"{self.name} gives {_shape(rates)}", f"give rates of the states' shape {tuple(shape)}"
            )
        return rates


def _shape(value: object) -> str:
    return f"shape {tuple(value.shape)}" if isinstance(value, Tensor) else type(value).__name__
