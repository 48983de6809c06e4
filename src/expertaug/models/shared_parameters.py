"""Expert parameters that all windows share: constants of a hybrid model, which are learned with it.

Their posterior is one for the whole training set, so that its divergence from p⁺ counts once, not with every window.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor, nn

from expertaug.errors import InputError
from expertaug.models.posterior import Delta, Gaussian, Posterior, bound_log_std, constrain
from expertaug.systems import System
from expertaug.systems.base import constant_like
from expertaug.wording import check_keys

FASTER = 10.0  # than an encoder's weights, of which many move an estimate, a constant must move by itself


class SharedParameters(nn.Module):
    """What stands in the place of an encoder's estimates of some expert parameters.

    Arguments:
        names: of the parameters.

    Raises:
        InputError: a name that is no expert parameter's, or is there twice.
    """

    stackable = True
    windows: Tensor

    def __init__(self, system: System, names: Sequence[str]) -> None:
        super().__init__()
        known = [p.name for p in system.expert_parameters]
        check_keys(names, known, "shared", "expert parameter")
        if len(set(names)) < len(names):
            raise InputError("shared", f"found {', '.join(names)}", "name each once")
        self.places = [known.index(name) for name in names]
        self.of_system = system.expert_parameters
        self.slow = nn.Parameter(torch.zeros(1, len(names)))
        self.slow_std = nn.Parameter(torch.zeros(1, len(names)))
        self.register_buffer("windows", torch.ones(1, 1))

    def fit(self, count: int) -> None:
        """Of a training set of so many windows."""
        self.windows.fill_(float(count))

    @property
    def loc(self) -> Tensor:
        """The constants before they are constrained, (…, 1, M)."""
        return FASTER * self.slow

    @property
    def log_std(self) -> Tensor:
        """Of the same, (…, 1, M)."""
        return bound_log_std(FASTER * self.slow_std)

    @property
    def stated(self) -> tuple[Tensor, Tensor]:
        """The constants in their units, (…, 1, M), and the standard deviations of their Gaussian posterior, where the
        model's encoder has one."""
        own = Gaussian(self.loc, self.log_std, [self.of_system[place] for place in self.places])
        return own.mean, own.spread

    def held(self, z_e: Tensor) -> Tensor:
        """Expert parameters (…, B, P) with the constants in their places."""
        return self._with(z_e, constrain(self.loc, [self.of_system[place] for place in self.places]))

    def posterior(self, encoded: Posterior) -> Posterior:
        """An encoder's posterior with that of the constants in their places."""
        z_e = encoded.z_e
        if isinstance(z_e, Gaussian):
            own = Gaussian(self._with(z_e.loc, self.loc), self._with(z_e.log_std, self.log_std), z_e.parameters)
            return replace(encoded, z_e=own)
        assert isinstance(z_e, Delta)
        return replace(encoded, z_e=Delta(self.held(z_e.loc), z_e.scale))

    def weights(self, each: Tensor) -> Tensor:
        """How much of a window's terms (…, B, P) counts: of a constant its share of the training set."""
        return self._with(torch.ones_like(each), 1 / self.windows)

    def _with(self, values: Tensor, constants: Tensor) -> Tensor:
        places = constant_like(values, self.places, torch.long)
        wide = constants.to(values).expand(*values.shape[:-1], len(self.places))
        return values.index_copy(-1, places, wide)
