"""The hybrid-VAE's objective (Takeishi and Kalousis 2021; paper, section 2 and app. HVAE)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.learning.augment import prior_ends
from expertaug.learning.objectives import Objective, diverged_share, finite_forecast, supervised_terms
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.residuals import sample_mean, squares
from expertaug.learning.training_data import Batch, Task
from expertaug.models.encoders.two_step import TwoStep
from expertaug.models.hybrid import HybridNet
from expertaug.models.posterior import unconstrain
from expertaug.presets import Choices

STREAM = 2  # of the random numbers: 0 are orders of data, 1 augmented samples
QUANTILES = 1000
RUNAWAY = 3.0  # times the largest value of the batch and of the first states by p⁺: what is beyond does not count


class HybridVAE(Objective):
    """Minimise −ELBO + α R_PPC + β R_DA1 + γ R_DA2, divided by the number of values that the likelihood compares.

    The paper's equation maximises a sum with plus signs; its appendix defines all three regularisers as penalties.
    With ŷ the forecast and ŷ_e the expert's alone for the same sampled z_e, over the loss window, and x the batch's:

    - ELBO: Gaussian log-likelihood of the observations around ŷ, of the learned scale σ, less the divergences of
      q(z_a) from N(0, I) and of q(z_e) from a Gaussian in the unbounded space of z_e that has the mean and standard
      deviation of p⁺ there;
    - R_PPC: ‖ŷ − ŷ_e‖² / 2σ², the divergence of the two likelihoods, plus the divergences of the ELBO once more;
    - R_DA1: ‖g_p1(x, y, z_a) − sg(ŷ_e)‖², on what the encoder sees of the observed window;
    - R_DA2: ‖g_p2(ŷ_e(x, z_e)) − z_e‖² for z_e ~ p⁺, in units of p⁺'s standard deviation; g_p2 stands for its mean.

    What keeps it stable where speeds are high (the authors' double pendulum was not): posterior standard deviations are
    bounded on both sides (:class:`TwoStep`), so that no sample of z lies far from where the decoder has been; σ has a
    floor and is set by the data alone, R_PPC taking it as given; a sample whose forecast runs away, as coarse steps of
    the solver make stiff or fast ones do, does not count in the terms that compare forecasts, and the divergence from
    p⁺ brings it back; and the loss is per observed value, so that clipping a gradient's norm means the same for short
    and long trajectories.

    Arguments:
        prior: ranges of p⁺.
        alpha, beta, gamma: weights of the regularisers.
    """

    learns_likelihood = True
    kept = ("step",)

    def __init__(
        self,
        seeds: Sequence[int],
        choices: Choices,
        prior: Mapping[str, Sequence[float]],
        alpha: float = 0.01,
        beta: float = 0.01,
        gamma: float = 1.0,
    ) -> None:
        super().__init__(seeds, choices)
        self.prior = prior
        self.alpha, self.beta, self.gamma = float(alpha), float(beta), float(gamma)
        self.step = 0

    def loss(self, model: HybridNet, batch: Batch, task: Task) -> tuple[Tensor, dict[str, Tensor]]:
        """Loss (S,) and its parts, each (S,), without gradient.

        Raises:
            InputError: the model's encoder is not a two-step encoder.
        """
        encoder, y, size = model.encoder, batch.y, batch.y.shape[2]
        if not isinstance(encoder, TwoStep):
            raise InputError("model.encoder.kind", type(encoder).__name__, "the hybrid-VAE needs a two-step encoder")
        noise = RandomStreams(self.seeds, self.step, STREAM, device=y.device)
        self.step += 1
        normal = partial(noise.normal, size)
        low, high = (end.to(y, non_blocking=True) for end in prior_ends(model.system, self.prior))
        sampled = self.choices.hvae_z_e == "sampled"

        window = batch.windows(task.observed)
        posterior, first = model.encode(window, normal), model.start(window)
        z_e = posterior.z_e.draw(normal) if sampled else posterior.z_e.mean
        z_plus = model.held(low + (high - low) * noise.uniform(size, len(low))).detach()
        start = model.system.initial_state(first, z_plus)
        largest = torch.maximum(*(x.abs().flatten(1).amax(1) for x in (y.movedim(1, 0).nan_to_num(), start)))
        limit, u = RUNAWAY * largest, batch.inputs(max(task.horizon, task.observed))
        states, good = _forecasts(model, first, (z_e, z_plus), posterior.z_a_used, task, limit, u)
        (hybrid, expert, plus), (hybrid_good, expert_good, plus_good) = states, good
        both_good = None if hybrid_good is None or expert_good is None else hybrid_good & expert_good

        divergence = posterior.z_a.divergence()
        if sampled:
            each = posterior.z_e.divergences(*raw_prior(model, self.prior))
            each = each if model.constants is None else each * model.constants.weights(each)
            divergence = divergence + each.sum(-1)
        later = slice(1, task.horizon)
        errors, compared = squares(model.system, hybrid[later], y[later], batch.complete)
        count = compared if isinstance(compared, int) else compared.float().mean().clamp_min(1.0)
        held = hybrid_good is None and expert_good is None
        apart, _ = squares(model.system, hybrid[later], expert[later], complete=held)  # within the bound
        likelihood = sample_mean(model.likelihood.log_prob(errors, compared), hybrid_good)
        ppc = apart / (2 * model.likelihood.scale.detach().square()) + divergence
        alone, over_prior = (replace(window, y=part[: task.observed]).joined for part in (expert, plus))
        filtered = posterior.filtered - encoder.view(alone).detach()
        inferred = encoder.infer(encoder.view(over_prior)).mean
        scale = ((high - low) / 12**0.5).clamp_min(1e-12)
        divergence = sample_mean(divergence)
        r_ppc = sample_mean(ppc, both_good)
        r_da1 = sample_mean(filtered.square().flatten(2).sum(2), expert_good)
        r_da2 = sample_mean(((inferred - z_plus) / scale).square().sum(-1), plus_good)
        loss = divergence - likelihood + self.alpha * r_ppc + self.beta * r_da1 + self.gamma * r_da2
        parts = {
            "data": sample_mean(errors, hybrid_good) / count,
            "divergence": divergence,
            "r_ppc": r_ppc,
            "r_da1": r_da1,
            "r_da2": r_da2,
            "runaway_share": diverged_share(divergence, hybrid_good),
            "sigma": model.likelihood.scale.flatten().expand(len(self.seeds)),
        }
        labelled, terms = supervised_terms(posterior, batch, task, self.choices.supervision)
        loss = loss if labelled is None else loss + labelled
        parts |= terms
        return loss / count, {k: v.detach() for k, v in (parts | {"loss": loss / count}).items()}


def _forecasts(
    model: HybridNet,
    first: Tensor,
    z: tuple[Tensor, Tensor],
    z_a: Tensor,
    task: Task,
    limit: Tensor,
    u: Tensor | None,
) -> tuple[tuple[Tensor, Tensor, Tensor], tuple[Tensor | None, Tensor | None, Tensor | None]]:
    """The hybrid's forecast, the expert's, and the expert's for z_e of p⁺, each with the samples that it holds for.

    While the expert is trained alone the first two are one. The third is asked for in the observed window alone, and
    has no gradient: of fields, whose solves cost what their samples cost, it has its own solve; of other systems it is
    a part of the one, which costs less than two.
    """
    z_e, z_plus = z
    size, points = z_e.shape[1], max(task.horizon, task.observed)
    own = [z_e] if model.interaction is None else [z_e, z_e]
    field = len(model.system.state_shape) > 1
    asked = own if field else [*own, z_plus]

    def repeated(count: int) -> Tensor | None:
        return None if u is None else torch.cat((u,) * count, dim=2)

    starts, inputs = torch.cat((first,) * len(asked), dim=1), repeated(len(asked))
    states, good = finite_forecast(model, starts, torch.cat(asked, dim=1), z_a, task, points, limit, inputs)
    parts = states.split(size, dim=2)
    goods = (None,) * len(parts) if good is None else good.split(size, dim=1)
    if field:
        with torch.no_grad(), model.decoder.expert_alone():
            seen = None if u is None else u[: task.observed]
            plus, plus_good = finite_forecast(model, first, z_plus, z_a, task, task.observed, limit, seen)
    else:
        plus, plus_good = parts[-1], goods[-1]
    expert = len(own) - 1
    return (parts[0], parts[expert], plus), (goods[0], goods[expert], plus_good)


def raw_prior(model: HybridNet, prior: Mapping[str, Sequence[float]]) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation (P,) of p⁺ in the unbounded space of z_e, from its quantiles.

    Raises:
        InputError: p⁺ reaches below zero where a parameter is positive.
    """
    low, high = prior_ends(model.system, prior)
    parameters = model.system.expert_parameters
    for parameter, least in zip(parameters, low.tolist(), strict=True):
        if parameter.positive and least < 0:
            raise InputError(f"augmentation.prior.{parameter.name}", f"starts at {least:g}", "it is positive")
    share = (torch.arange(QUANTILES) + 0.5).unsqueeze(-1) / QUANTILES
    raw = unconstrain(low + (high - low) * share, parameters)
    return raw.mean(0), raw.std(0).clamp_min(1e-3)
