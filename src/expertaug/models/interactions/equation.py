"""An interaction model that is an equation: a sum of terms that can be read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.models.interactions.base import Interaction
from expertaug.models.settings import EquationSettings, configure_by
from expertaug.models.terms import Term, quantities
from expertaug.systems import System


@configure_by(EquationSettings)
class EquationInteraction(Interaction):
    """F_a = Σ c_k f_k(y, u; z_e), each term in the rate of one component (:class:`~expertaug.models.terms.Term`).

    A coefficient is a number, the same for all windows, or the next component of z_a.

    Arguments:
        latent: size of z_a: as many as there are coefficients that are no numbers.
        functions: of terms that are no arithmetic, by the terms' names.
    """

    stackable = True

    def __init__(self, system: System, latent: int, functions: Mapping[str, Any] | None = None, **options: Any) -> None:
        own = EquationSettings.of(**options)
        entries = [Term.of(text) if text not in (functions or {}) else text for text in own.terms]
        terms = [t if isinstance(t, Term) else _with_function(t, (functions or {})[t]) for t in entries]
        self.terms = [term.check(system) for term in terms]
        self.coefficients = list(own.coefficients or [None] * len(terms))
        free = self.coefficients.count(None)
        if free != latent:
            raise InputError(
                "model.interaction.coefficients", f"{free} of them are left to z_a", f"z_a has {latent} components"
            )
        super().__init__(system, latent, components=list(dict.fromkeys(term.rate for term in terms)) or None)
        self.system, self.width = system, len(terms)
        names = {name for term in self.terms for name in term.names}
        functional = any(term.function is not None for term in self.terms)
        self.names = None if functional else names
        self.sees_inputs = bool(system.known) and (functional or bool(names & {p.name for p in system.known}))

    def latents(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, Q) and z_e (…, B, P) → coefficients, then expert parameters, (…, B, K + P)."""
        free = iter(z_a.unbind(-1))
        coefficients = [next(free) if c is None else z_e.new_full(z_e.shape[:-1], c) for c in self.coefficients]
        if not coefficients:
            return z_e
        return torch.cat((torch.stack(coefficients, dim=-1), z_e), dim=-1)

    def forward(self, y: Tensor, context: Tensor, known: Tensor | None = None) -> Tensor:
        """F_a at states y (…, B, *state), the shape of y; ``known`` as of :class:`Interaction`."""
        if not self.terms:
            return torch.zeros_like(y)
        count, space = len(self.terms), len(self.system.state_shape) - 1
        values = quantities(self.system, y, context[..., count:], known, self.names)
        rates: dict[str, Tensor] = {}
        for k, term in enumerate(self.terms):
            coefficient = context[..., k]
            added = (coefficient[(..., *[None] * space)] if space else coefficient) * term.value(values)
            rates[term.rate] = rates[term.rate] + added if term.rate in rates else added
        nothing = torch.zeros_like(next(iter(rates.values())))
        return torch.stack([rates.get(p.name, nothing) for p in self.system.state], dim=-1 - space)


def _with_function(text: str, function: Any) -> Term:
    rate, _, name = text.partition(":")
    return Term(rate.strip(), name.strip(), function)
