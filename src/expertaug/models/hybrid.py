"""The hybrid model: what it is made of (:class:`HybridModel`), and the networks made of that (:class:`HybridNet`)."""

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
from expertaug.models.observation_noise import GaussianLikelihood
from expertaug.models.posterior import Estimates, Normal, Posterior, Predictor
from expertaug.models.settings import PARTS
from expertaug.models.shared_parameters import SharedParameters
from expertaug.models.stacking import Network, stack
from expertaug.models.user_modules import encoder_of, interaction_of
from expertaug.systems import System
from expertaug.systems.inputs import as_observed, states_of
from expertaug.systems.solvers.solver import Solver
from expertaug.windows import Windows


class HybridNet(Predictor, nn.Module):
    """An amortised :class:`~expertaug.models.posterior.Estimator` and the decoder that is trained with it.

    Arguments:
        encoder: observed window → posterior.
        decoder: (y0, z_e, z_a) → states.
        gaps: what stands for values of windows that were not measured (NaN); None: every value is measured.
        constants: expert parameters that all windows share; None: each window has its own.
    """

    # Parameters of p_θ, which fine-tuning leaves alone, begin with one of these.
    decoder_prefixes = ("decoder.", "constants.")

    def __init__(
        self,
        encoder: nn.Module,
        decoder: Decoder,
        gaps: Gaps | None = None,
        constants: SharedParameters | None = None,
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.decoder = decoder
        self.gaps = gaps
        self.constants = constants

    @property
    def system(self) -> System:
        return self.decoder.system

    @property
    def interaction(self) -> nn.Module | None:
        return self.decoder.interaction

    @property
    def likelihood(self) -> nn.Module | None:
        return self.decoder.likelihood

    def fit(self, windows: Windows) -> None:
        """Let the parts that learn scales from the training set's observed windows, y (T1, N, *state), do so."""
        seen = self.seen(windows)
        self.encoder.fit(seen)  # type: ignore[operator]
        self.decoder.fit(states_of(self.system, seen))
        if self.constants is not None:
            self.constants.fit(seen.shape[1])

    def seen(self, windows: Windows) -> Tensor:
        """What the encoder sees of observed windows, (T1, …, B, *observed): without gaps, the known inputs as further
        components of the state."""
        return (windows if self.gaps is None else self.gaps.filled(windows)).joined

    def start(self, windows: Windows) -> Tensor:
        """The first points (…, B, *state) of observed windows, estimated where they were not measured."""
        return windows.y[0] if self.gaps is None else self.gaps.start(windows)

    def encode(self, windows: Windows, normal: Normal | None = None) -> Posterior:
        """Observed windows → q(z_e, z_a); of an encoder in two steps q(z_e) given a sample of z_a by ``normal``."""
        seen = self.seen(windows)
        posterior = self.encoder(seen) if normal is None else self.encoder(seen, normal)
        return posterior if self.constants is None else self.constants.posterior(posterior)

    def held(self, z_e: Tensor) -> Tensor:
        """Expert parameters (…, B, P) with those that all windows share at their constants."""
        return z_e if self.constants is None else self.constants.held(z_e)

    def estimate(self, windows: Windows) -> Estimates:
        """Observed windows → the posterior's means, from the first point."""
        posterior = self.encode(windows)
        return Estimates(self.start(windows), *posterior.mean, posterior)

    def forecast(
        self, y0: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor, solver: Solver, u: Tensor | None = None
    ) -> Tensor:
        """The decoder's: states (T, …, B, *state) at the times t (T,), from y0 (…, B, *state)."""
        return self.decoder.forecast(y0, z_e, z_a, t, solver, u)

    def interaction_squares(
        self, y: Tensor, z_e: Tensor, z_a: Tensor, t: Tensor | None = None, u: Tensor | None = None
    ) -> Tensor:
        """The decoder's: mean over the state's dimensions of F_a² at every point, (…, B·T)."""
        return self.decoder.interaction_squares(y, z_e, z_a, t, u)


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
        shared: expert parameters that all windows share: constants of the model instead of estimates of the encoder.
    """

    system: System
    encoder: Part
    interaction: Part | None = None
    expert: bool = True
    shared: Sequence[str] = ()

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
        seen = as_observed(self.system)
        encoder = encoder_of(_make("encoder", self.encoder, system=seen, times=times), seen)
        interaction = None
        if self.interaction is not None:
            interaction = _interaction(self.system, self.interaction, encoder.latent, times)
        likelihood_model = GaussianLikelihood() if likelihood else None
        decoder = Decoder(self.system, interaction, self.expert, likelihood_model)
        constants = SharedParameters(self.system, self.shared) if self.shared else None
        return HybridNet(encoder, decoder, None if start is None else Gaps(self.system, times, start), constants)


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


def _interaction(system: System, spec: Part, latent: object, times: Tensor) -> nn.Module:
    return interaction_of(_make("interaction", spec, system=system, latent=latent, times=times), system)


def _one_a_seed(build: Callable[[], Network], seeds: Sequence[int]) -> Network:
    """Networks that are built from each seed, stacked."""
    models = []
    for seed in seeds:
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            models.append(build())
    return stack(models)


def _resolve(part: str, spec: Part) -> tuple[type, str, dict]:
    """Class, name for messages and arguments of any form of a part."""
    where = f"model.{part}.kind"
    if isinstance(spec, Mapping):
        arguments = dict(spec)
        kind = arguments.pop("kind", None)
        return registry.find(PARTS[part], kind, where), str(kind), arguments
    if isinstance(spec, partial):
        if spec.args:
            raise InputError(f"model.{part}", "arguments without a name", "give them by name in functools.partial")
        return registry.check(PARTS[part], spec.func, where), getattr(spec.func, "__name__", ""), dict(spec.keywords)
    if not inspect.isclass(spec):
        class_name, remedy = type(spec).__name__, "give a class, functools.partial of it, or a mapping with kind"
        raise InputError(f"model.{part}", f"found {class_name}", remedy)
    return registry.check(PARTS[part], spec, where), spec.__name__, {}


def _make(part: str, spec: Part, **fixed: object) -> nn.Module:
    cls, name, arguments = _resolve(part, spec)
    accepted = registry.arguments(cls)
    if accepted is not None:
        free = sorted(set(accepted) - set(fixed))
        for key in arguments:
            if key not in free:
                raise InputError(f"model.{part}.{key}", f"unknown to {name}", f"known: {', '.join(free) or 'none'}")
        fixed = {key: value for key, value in fixed.items() if key in accepted}
    try:
        inspect.signature(cls).bind(**fixed, **arguments)
    except TypeError as error:
        raise InputError(f"model.{part}", f"{name}: {error}", "give what its constructor needs") from error
    try:
        return cls(**fixed, **arguments)
    except InputError:
        raise
    except Exception as error:
        problem = f"{name} refuses its arguments ({type(error).__name__}: {error})"
        raise InputError(f"model.{part}", problem, "correct them, or the class") from error
