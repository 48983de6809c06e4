"""What a hybrid model is made of, before it knows any data."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.hybrid import HybridModel as HybridNet
from expertaug.models.hybrid import stack
from expertaug.models.likelihood import GaussianLikelihood
from expertaug.registry import find
from expertaug.systems import System

Part = Mapping | Callable[..., nn.Module]


@dataclass(frozen=True)
class HybridModel:
    """A system's expert, an encoder and an interaction model: dy/dt = F_e(y; z_e) + F_a(y; z_a).

    Attributes:
        system: gives F_e.
        encoder: a class, called with (system, times), or a functools.partial of one, or {"kind": name, arguments}.
        interaction: the same, called with (system, latent); None: the expert alone.
        expert: False takes F_e away: the neural ODE.
    """

    system: System
    encoder: Part
    interaction: Part | None = None
    expert: bool = True

    def build(self, times: Tensor, seeds: list[int], likelihood: bool = False) -> HybridNet:
        """The network for a group of seeds, one initialisation each."""
        nets = []
        for seed in seeds:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(seed)
                encoder = _make("encoder", self.encoder, system=self.system, times=times)
                interaction = None
                if self.interaction is not None:
                    interaction = _make("interaction", self.interaction, system=self.system, latent=encoder.latent)
                scale = GaussianLikelihood() if likelihood else None
                nets.append(HybridNet(self.system, encoder, interaction, self.expert, scale))
        return stack(nets)


def _make(part: str, given: Part, **fixed: object) -> nn.Module:
    if not isinstance(given, Mapping):
        return given(**fixed)
    arguments = dict(given)
    kind = str(arguments.pop("kind", ""))
    cls = find(part, kind, f"model.{part}.kind")
    known = set(inspect.signature(cls).parameters) - set(fixed)
    for key in arguments:
        if key not in known:
            raise InputError(f"model.{part}.{key}", f"unknown to {kind}", f"known: {', '.join(sorted(known))}")
    return cls(**fixed, **arguments)
