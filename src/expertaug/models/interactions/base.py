"""The interaction model F_a(y; z_a)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.systems import System
from expertaug.systems.base import constant_like


def positions(system: System, components: Sequence[str], key: str) -> list[int]:
    """Where in the state components are that a configuration's key names.

    Raises:
        InputError: the state has no component of that name.
    """
    names = [c.name for c in system.state]
    for name in components:
        if name not in names:
            raise InputError(key, repr(name), f"components of the state: {', '.join(names)}")
    return [names.index(name) for name in components]


class Interaction(nn.Module):
    """What every F_a shares: a subclass gives ``forward(y, context)``.

    Where it has something to prepare once a trajectory, it gives ``context(z_a, z_e)`` too.

    Arguments:
        latent: size of z_a.
        expert_parameters: whether F_a sees z_e too, each divided by its scale: F_a(y; z_a, z_e).
        components: of the state, by name, on whose rates F_a acts; null for all.  A rate that is another component by
            definition (θ' of a pendulum) is better left alone: a damping of least norm would act on it in part, and
            be a stiffness where the motion is slower.
        reads: components of the state, by name, that F_a sees; null for all.  What a term is known not to depend on is
            better kept from it: APHYNITY takes the smallest F_a that fits, and a damping that sees the angle takes a
            share of the restoring force, since in a swing that dies away angle and speed are correlated.

    Attributes:
        inputs: how many numbers :meth:`latents` gives.
        acts_on, sees: positions in the state of the components on which F_a acts, and that it sees.
        sees_inputs, sees_time: whether ``forward`` is given the known inputs (…, B, U), and the time in s after them,
            as a third argument.
        width: about how many numbers it makes of one state.
    """

    sees_inputs = False
    sees_time = False
    width = 0

    def __init__(
        self,
        system: System,
        latent: int,
        expert_parameters: bool = False,
        components: Sequence[str] | None = None,
        reads: Sequence[str] | None = None,
    ) -> None:
        super().__init__()
        every = [c.name for c in system.state]
        self.scales = [p.scale for p in system.expert_parameters] if expert_parameters else []
        self.inputs = latent + len(self.scales)
        self.acts_on = positions(system, components or every, "model.interaction.components")
        self.sees = positions(system, reads or every, "model.interaction.reads")
        self._axis = -len(system.state_shape)

    def fit(self, observed: Tensor) -> None:
        """Learn scales from the training set's observed window (T1, N, *state); nothing, unless overridden."""

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → (…, B, width), what :meth:`forward` needs of them for a trajectory."""
        return self.latents(z_a, z_e)

    def along(self, context: Tensor) -> Callable[..., Tensor]:
        """:meth:`forward` for trajectories of which this is the context, of y and what else it is given: asked for once
        a solve, so that what no state changes need not be looked up at every step."""
        return lambda y, *known: self(y, context, *known)

    def linearised(self, context: Tensor) -> Callable[..., tuple[Tensor, Tensor]] | None:
        """For the same arguments as :meth:`along` the rates, whose gradient reaches what F_a is made of but not y, and
        ∂ rate / ∂ y (R, …, B, K) of the R components that F_a acts on; None: let backpropagation find it."""
        return None

    def latents(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a (…, B, latent) and z_e (…, B, P) → what F_a may see of them, (…, B, inputs)."""
        return torch.cat((z_a, z_e / constant_like(z_e, self.scales, z_e.dtype)), dim=-1) if self.scales else z_a

    def placed(self, rates: Tensor, y: Tensor) -> Tensor:
        """Rates of the components that F_a acts on → rates of all, the shape of y; the others are zero."""
        if len(self.acts_on) == y.shape[self._axis]:
            return rates
        return torch.zeros_like(y).index_copy(self._axis, constant_like(y, self.acts_on, torch.long), rates)
