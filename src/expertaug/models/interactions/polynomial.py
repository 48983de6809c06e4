"""An interaction model that is a polynomial of the state."""

from __future__ import annotations

from itertools import combinations_with_replacement
from math import prod
from typing import Any

import torch
from torch import Tensor, nn

from expertaug.models.interactions.base import Interaction
from expertaug.models.networks.layers import MLP
from expertaug.models.settings import PolynomialSettings, configure_by
from expertaug.systems import System

# Standard deviations of the training set from which the terms stay constant: no cubic sends a forecast to infinity.
FARTHEST = 10.0
START = 0.01  # of a linear layer's usual first size


@configure_by(PolynomialSettings)
class PolynomialInteraction(Interaction):
    """F_a(y; z_a) = Σ c_i(z_a) φ_i(y), φ_i the polynomials that are orthonormal over the training set's states.

    Where the state is made of fields, each cell's rate depends on that cell alone: a local reaction.  Beyond the states
    seen in training a polynomial goes on as it must, where a network goes on straight; orthonormal terms make its
    coefficients equally well determined, which a forecast far beyond those states needs.  Coefficients of terms up to
    ``latent_degree`` depend on z_a (0: the constant alone), linearly where there are no hidden layers between.

    Arguments:
        latent: size of z_a.
    """

    stackable = True
    mean: Tensor
    std: Tensor
    mix: Tensor

    def __init__(self, system: System, latent: int, **options: Any) -> None:
        own = PolynomialSettings.of(**options)
        super().__init__(system, latent, own.expert_parameters, own.components, own.reads)
        self.size, self.cells = system.state_shape[0], prod(system.state_shape[1:])
        self.variables = len(self.sees)
        # Term k is term ``self.factors[k][0]`` times variable ``self.factors[k][1]``; term 0 is 1.
        terms = [c for d in range(own.degree + 1) for c in combinations_with_replacement(range(self.variables), d)]
        self.factors = [(terms.index(term[:-1]), term[-1]) for term in terms[1:]]
        self.terms, varying = len(terms), sum(len(term) <= own.latent_degree for term in terms)
        self.register_buffer("mean", torch.zeros(self.variables, 1))
        self.register_buffer("std", torch.ones(self.variables, 1))
        self.register_buffer("mix", torch.eye(self.terms))
        self.varying = MLP(self.inputs, own.layers, len(self.acts_on) * varying)
        # Near zero: a random rate would carry the first forecasts beyond the states of the data, and a large weight of
        # z_a lets what the encoder makes of unseen windows weigh too much.
        for parameter in self.varying.layers[-1].parameters():
            parameter.data *= START
        self.width, rest = self.terms, len(self.acts_on) * (self.terms - varying)
        # Zero: a random cubic would send forecasts to infinity before it is trained.
        self.fixed = nn.Parameter(torch.zeros(1, rest)) if rest else None

    def fit(self, observed: Tensor) -> None:
        """Make the terms orthonormal over the training set's observed window (T1, N, *state)."""
        y = self._variables(observed.reshape(-1, self.size, self.cells))
        variance, mean = torch.var_mean(y, dim=(0, 2))
        self.mean.copy_(mean.unsqueeze(-1).expand_as(self.mean))
        self.std.copy_(variance.sqrt().clamp_min(1e-6).unsqueeze(-1).expand_as(self.std))
        scaling = [b if b.dim() == 2 else b[0] for b in (self.mean, self.std)]
        moments = torch.zeros(self.terms, self.terms, dtype=torch.float64, device=y.device)
        for part in y.split(1024):
            terms = self._monomials((part - scaling[0]) / scaling[1]).transpose(0, 1).flatten(1).double()
            moments += terms @ terms.T
        moments /= y.shape[0] * y.shape[2]
        inverse = torch.linalg.inv(torch.linalg.cholesky(moments + 1e-9 * torch.eye(self.terms).to(moments)))
        self.mix.copy_(inverse.expand_as(self.mix))

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → coefficients of the monomials (…, B, rates · terms)."""
        z_a = self.latents(z_a, z_e)
        coefficients = self.varying(z_a).unflatten(-1, (len(self.acts_on), -1))
        if self.fixed is not None:
            fixed = self.fixed.unflatten(-1, (len(self.acts_on), -1))
            coefficients = torch.cat((coefficients, fixed.expand(*coefficients.shape[:-1], -1)), dim=-1)
        return (coefficients @ self.mix.unsqueeze(-3)).flatten(-2)

    def forward(self, y: Tensor, context: Tensor) -> Tensor:
        """F_a at states y (…, B, *state), the shape of y."""
        lead = context.shape[:-1]
        x = self._variables(y.reshape(*lead, self.size, self.cells))
        x = (x - self.mean.unsqueeze(-3)) / self.std.unsqueeze(-3)
        x = x.clamp(-FARTHEST, FARTHEST)
        rates = context.unflatten(-1, (len(self.acts_on), self.terms)) @ self._monomials(x)
        return self.placed(rates.view(*lead, len(self.acts_on), *y.shape[len(lead) + 1 :]), y)

    def _variables(self, y: Tensor) -> Tensor:
        """States (…, components, cells) → what the terms are made of, (…, variables, cells)."""
        return y if self.variables == self.size else y[..., self.sees, :]

    def _monomials(self, x: Tensor) -> Tensor:
        """(…, variables, cells) → (…, terms, cells)."""
        variables = x.unbind(-2)
        terms = [torch.ones_like(variables[0])]
        for other, variable in self.factors:
            terms.append(terms[other] * variables[variable] if other else variables[variable])
        return torch.stack(terms, dim=-2)
