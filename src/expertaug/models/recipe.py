"""The recipe of a hybrid model: a system, an encoder and an interaction model, from which networks are made."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from torch import Tensor, nn

from expertaug import registry
from expertaug.errors import InputError
from expertaug.models.decoder import Decoder
from expertaug.models.gaps import Gaps
from expertaug.models.hybrid import HybridNet
from expertaug.models.kinds import PARTS
from expertaug.models.likelihood import GaussianLikelihood
from expertaug.models.plain import encoder_of, interaction_of
from expertaug.models.stacking import Network, stack
from expertaug.systems import System
from expertaug.systems.inputs import observed

# {"kind": …, and the class's arguments}, the class, or functools.partial of it and its arguments.
Part = Mapping | Callable


@dataclass(frozen=True)
class HybridModel:
    """What a hybrid model is made of; :meth:`build` makes the networks.

    Attributes:
        system: gives F_e.
        encoder: observed window → posterior: a mapping with ``kind`` (a short one or ``package.module:Class``) and the
            class's arguments, the class itself, or functools.partial of it.  It is given ``system`` and ``times`` (T1,)
            where it takes them.
        interaction: F_a in the same forms, given ``system`` and ``latent``, the size of z_a; None: the expert alone.
        expert: False takes F_e away and keeps the system's kinematics: the agnostic neural ODE.
    """

    system: System
    encoder: Part
    interaction: Part | None = None
    expert: bool = True

    def build(
        self,
        times: Tensor | Sequence[float],
        seeds: Sequence[int],
        likelihood: bool = False,
        start: Mapping[str, Sequence[float]] | None = None,
    ) -> HybridNet:
        """Networks for a group of seeds, one initialisation a seed, stacked.

        Arguments:
            times: of the observed window in s, (T1,).
            seeds: S of them.
            likelihood: whether the objective learns a likelihood's scale.
            start: range of each component of a first point, where windows may have values that were not measured.

        Raises:
            InputError: an unknown kind or argument, or one that the class refuses.
        """
        return _one_a_seed(lambda: self.build_one(times, likelihood, start), seeds)

    def build_one(
        self,
        times: Tensor | Sequence[float],
        likelihood: bool = False,
        start: Mapping[str, Sequence[float]] | None = None,
    ) -> HybridNet:
        """One network from torch's random state as it is, not stacked; arguments as :meth:`build`."""
        times = torch.as_tensor(times, dtype=torch.float64)
        seen = observed(self.system)
        encoder = encoder_of(_make("encoder", self.encoder, system=seen, times=times), seen)
        interaction = None
        if self.interaction is not None:
            interaction = _interaction(self.system, self.interaction, encoder.latent, times)
        likelihood_model = GaussianLikelihood() if likelihood else None
        decoder = Decoder(self.system, interaction, self.expert, likelihood_model)
        return HybridNet(encoder, decoder, None if start is None else Gaps(self.system, times, start))


def build_decoder(
    system: System, interaction: Part, latent: int, seeds: Sequence[int], times: Tensor | Sequence[float]
) -> Decoder:
    """Decoders without an encoder for a group of seeds, one initialisation a seed, stacked.

    Arguments:
        interaction: F_a, as of :class:`HybridModel`.
        latent: size of z_a.
        times: of the observed window in s, (T1,).

    Raises:
        InputError: as :meth:`HybridModel.build`.
    """
    times = torch.as_tensor(times, dtype=torch.float64)
    return _one_a_seed(lambda: Decoder(system, _interaction(system, interaction, latent, times)), seeds)


def _interaction(system: System, given: Part, latent: object, times: Tensor) -> nn.Module:
    return interaction_of(_make("interaction", given, system=system, latent=latent, times=times), system)


def _one_a_seed(build: Callable[[], Network], seeds: Sequence[int]) -> Network:
    """Networks that are built from each seed, stacked."""
    models = []
    for seed in seeds:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            models.append(build())
    return stack(models)


def _resolved(part: str, given: Part) -> tuple[type, str, dict]:
    """Class, name for messages and arguments of any form of a part."""
    where = f"model.{part}.kind"
    if isinstance(given, Mapping):
        arguments = dict(given)
        kind = arguments.pop("kind", None)
        return registry.find(PARTS[part], kind, where), str(kind), arguments
    if isinstance(given, partial):
        if given.args:
            raise InputError(f"model.{part}", "arguments without a name", "give them by name in functools.partial")
        return registry.check(PARTS[part], given.func, where), getattr(given.func, "__name__", ""), dict(given.keywords)
    if not inspect.isclass(given):
        found, remedy = type(given).__name__, "give a class, functools.partial of it, or a mapping with kind"
        raise InputError(f"model.{part}", f"found {found}", remedy)
    return registry.check(PARTS[part], given, where), given.__name__, {}


def _make(part: str, given: Part, **fixed: object) -> nn.Module:
    cls, name, arguments = _resolved(part, given)
    known = registry.arguments(cls)
    if known is not None:
        free = sorted(set(known) - set(fixed))
        for key in arguments:
            if key not in free:
                raise InputError(f"model.{part}.{key}", f"unknown to {name}", f"known: {', '.join(free) or 'none'}")
        fixed = {key: value for key, value in fixed.items() if key in known}
    try:
        inspect.signature(cls).bind(**fixed, **arguments)
    except TypeError as error:
        raise InputError(f"model.{part}", f"{name}: {error}", "give what its constructor needs") from error
    try:
        return cls(**fixed, **arguments)
    except InputError:
        raise
    except Exception as error:
        found = f"{name} refuses its arguments ({type(error).__name__}: {error})"
        raise InputError(f"model.{part}", found, "correct them, or the class") from error
