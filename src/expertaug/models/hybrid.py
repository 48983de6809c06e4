"""The hybrid network of a group of seeds: a decoder, and an encoder that estimates at once for all windows."""

from __future__ import annotations

from torch import Tensor, nn

from expertaug.models.decoder import Decoder
from expertaug.models.estimates import Estimates
from expertaug.models.gaps import Gaps
from expertaug.models.posterior import Posterior
from expertaug.models.prediction import Predictor
from expertaug.systems import System
from expertaug.systems.inputs import states_of
from expertaug.systems.solvers.solver import Solver


class HybridNet(Predictor, nn.Module):
    """An amortised :class:`~expertaug.models.estimates.Estimator` and the decoder that is trained with it.

    Arguments:
        encoder: observed window → posterior.
        decoder: (y0, z_e, z_a) → states.
        gaps: what stands for values of windows that were not measured (NaN); None: every value is measured.
    """

    # Parameters of p_θ, which fine-tuning leaves alone, begin with one of these.
    decoder_prefixes = ("decoder.",)

    def __init__(self, encoder: nn.Module, decoder: Decoder, gaps: Gaps | None = None) -> None:
        super().__init__()
        self.encoder = encoder
        self.decoder = decoder
        self.gaps = gaps

    @property
    def system(self) -> System:
        return self.decoder.system

    @property
    def interaction(self) -> nn.Module | None:
        return self.decoder.interaction

    @property
    def likelihood(self) -> nn.Module | None:
        return self.decoder.likelihood

    def fit(self, observed: Tensor) -> None:
        """Let the parts that learn scales from the training set's observed window (T1, N, *observed) do so."""
        observed = self.filled(observed)
        self.encoder.fit(observed)
        self.decoder.fit(states_of(self.system, observed))

    def filled(self, observed: Tensor) -> Tensor:
        """Observed windows (T1, …, B, *observed) as the encoder sees them."""
        return observed if self.gaps is None else self.gaps.filled(observed)

    def start(self, observed: Tensor) -> Tensor:
        """The first points (…, B, *state) of observed windows (T1, …, B, *observed), estimated where not measured."""
        return states_of(self.system, observed[0]) if self.gaps is None else self.gaps.start(observed)

    def encode(self, observed: Tensor) -> Posterior:
        """Observed window (T1, …, B, *observed), known inputs as further components of the state → q(z_e, z_a)."""
        return self.encoder(self.filled(observed))

    def estimate(self, windows: Tensor) -> Estimates:
        """Observed windows (T1, …, B, *observed) → the posterior's means, from the first point."""
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
