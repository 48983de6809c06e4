"""Training objectives: one loss per seed and its named parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import prod

import torch
from torch import Tensor

from expertaug.learning.divergence import forecast_or_fallback, within_bound
from expertaug.learning.expert_share import decorrelate, expert_sizes, squares_beside_expert
from expertaug.learning.residuals import mean_squared_error
from expertaug.learning.training_data import Batch, Task
from expertaug.models.hybrid import HybridNet
from expertaug.models.posterior import Posterior
from expertaug.presets import Choices


def finite_forecast(
    model: HybridNet,
    y0: Tensor,
    z_e: Tensor,
    z_a: Tensor,
    task: Task,
    points: int,
    limit: Tensor | None = None,
    u: Tensor | None = None,
) -> tuple[Tensor, Tensor | None]:
    """A training batch's forecast (T, S, B, *state), and which samples (S, B) it holds for; None where for all.

    One sample whose speeds run away within a coarse step would make its seed's whole gradient NaN.  What is not finite
    or beyond the task's bound is left out: it is solved again with its seed's mean latents, which carry no gradient,
    or, where these run away as well, in place of it a sample of its seed that does not; and it does not count.  Samples
    beyond those of z_a follow the expert alone.  With ``limit`` (S,) a sample also runs away where a value is beyond
    it.  Known inputs u (T, S, B, U) at these points, of a system that has some, are those of the samples.  A task with
    doubts gets that all samples hold as one more of them.
    """
    t = task.t[:points]

    def near(prediction: Tensor) -> Tensor:
        bounded = within_bound(prediction, task.bound)
        if limit is None:
            return bounded
        largest = prediction.detach().abs().movedim(0, 2).flatten(2).amax(-1)
        return bounded & (largest <= limit.unsqueeze(-1))

    prediction = forecast_or_fallback(model, y0, z_e, z_a, t, task.solver, u)
    good = near(prediction)
    if task.doubts is not None:
        task.doubts.append(good.all())
        return prediction, None
    if good.all():
        return prediction, None
    weight = good.unsqueeze(-1)

    def replaced(z: Tensor) -> Tensor:
        kept = weight[:, : z.shape[1]]
        mean = (z.detach().nan_to_num() * kept).sum(1, keepdim=True) / kept.sum(1, keepdim=True).clamp_min(1)
        return torch.where(kept, z, mean)

    z_e, z_a = replaced(z_e), replaced(z_a)
    prediction = forecast_or_fallback(model, y0, z_e, z_a, t, task.solver, u)
    again = near(prediction) | good
    if not again.all():
        parts = [slice(0, z_a.shape[1]), slice(z_a.shape[1], None)]
        y0, z_e = (torch.cat([_from_good(x[:, p], again[:, p]) for p in parts], dim=1) for x in (y0, z_e))
        if u is not None:
            each = u.movedim(0, 2)
            u = torch.cat([_from_good(each[:, p], again[:, p]) for p in parts], dim=1).movedim(2, 0)
        prediction = forecast_or_fallback(model, y0, z_e, _from_good(z_a, again[:, parts[0]]), t, task.solver, u)
    return prediction, good


def diverged_share(each_seed: Tensor, good: Tensor | None) -> Tensor:
    """Share (S,) of a batch's samples that were left out; ``each_seed`` is any tensor (S,) of the batch."""
    return torch.zeros_like(each_seed.detach()) if good is None else 1 - good.float().mean(1)


def _from_good(x: Tensor, good: Tensor) -> Tensor:
    """x (S, B, …) with the first good sample (S, B) of its seed, without gradient, in place of those that are not."""
    if not x.shape[1]:
        return x
    first = x.detach()[torch.arange(len(x), device=x.device), good.int().argmax(1)].unsqueeze(1)
    return torch.where(good.view(*good.shape, *[1] * (x.dim() - 2)), x, first)


def supervision(posterior: Posterior, batch: Batch, task: Task, choice: str) -> Tensor | None:
    """Mean over the labelled samples of the z_e term (S,); None where there is none.

    Arguments:
        choice: the preset's row supervision: −log q(z_e | x, y) with z_e in units of p⁺'s standard deviation, or the
            squared error of the posterior's mean in the parameters' own units.
    """
    if choice == "off" or not batch.has_labels:
        return None
    count = batch.supervised.sum(1)
    mean = posterior.z_e.mean
    labels = torch.where(batch.supervised.bool().unsqueeze(-1), batch.z_e, mean.detach())  # others may be impossible
    raw = choice == "raw"
    each = (mean - labels).square().sum(-1) if raw else -posterior.z_e.log_prob_in(labels, task.z_e_scale)  # type: ignore[attr-defined]
    return (each * batch.supervised).sum(1) / count.clamp_min(1)


def latent_supervision(posterior: Posterior, batch: Batch, task: Task) -> Tensor | None:
    """Mean over the labelled samples of −log q(z_a | x, y) (S,), with z_a in units of its spread over the training
    windows; None where there is none.

    The paper supervises z_e alone; but the z_a of an augmented sample was drawn as its z_e was, and an encoder that
    finds one may lose the other: F_a has learned nothing beyond the training windows' z_a.
    """
    if not task.z_a_supervision_weight or not batch.has_labels or batch.z_a is None:
        return None
    mean = posterior.z_a.mean
    labels = torch.where(batch.supervised.bool().unsqueeze(-1), batch.z_a, mean.detach())  # others have none
    each = -posterior.z_a.log_prob_in(labels, task.z_a_scale)  # type: ignore[attr-defined]
    return (each * batch.supervised).sum(1) / batch.supervised.sum(1).clamp_min(1)


def supervised_terms(posterior: Posterior, batch: Batch, task: Task, choice: str) -> tuple[Tensor | None, dict]:
    """What a loss (S,) adds for the labels of augmented samples, and its parts; None where nothing is labelled.

    Arguments:
        choice: as of :func:`supervision`.
    """
    weighted = (
        ("z_e", task.supervision_weight, supervision(posterior, batch, task, choice)),
        ("z_a", task.z_a_supervision_weight, latent_supervision(posterior, batch, task)),
    )
    total, parts = None, {}
    for name, weight, term in weighted:
        if term is not None:
            total = weight * term if total is None else total + weight * term
            parts[name] = term.detach()
    return total, parts


class Objective:
    """What the trainer minimises.  A subclass needs :meth:`loss` and may need the others.

    Arguments:
        seeds: of the group, in its order.
        choices: rows of the preset.

    A subclass's further arguments are options in the configuration; one called ``prior`` gets the ranges of p⁺.

    Attributes:
        learns_likelihood: whether the model needs a likelihood with a learned scale.
        kept: attributes that a checkpoint keeps.
    """

    learns_likelihood = False
    kept: tuple[str, ...] = ()

    def __init__(self, seeds: Sequence[int], choices: Choices) -> None:
        self.seeds, self.choices = list(seeds), choices

    def loss(self, model: HybridNet, batch: Batch, task: Task) -> tuple[Tensor, dict[str, Tensor]]:
        """Loss (S,) and its parts, each (S,), without gradient; it compares the first ``task.horizon`` points."""
        raise NotImplementedError

    def window(self, task: Task) -> int:
        """Points that the loss compares once the window has grown to its full length."""
        return task.horizon

    def begin(self, model: HybridNet, batch: Batch, task: Task) -> None:
        """Called before the first update with its batch and the loss window at its full length."""

    def end_of_pass(self) -> None:
        """Called after every pass over the training set."""

    def carried(self) -> dict:
        """Options, of plain numbers, that fine-tuning takes over from the end of training."""
        return {}

    def state(self) -> dict:
        """What a checkpoint keeps."""
        return {name: getattr(self, name) for name in self.kept}

    def restore(self, state: Mapping[str, Tensor | float]) -> None:
        """Take up what :meth:`state` gave."""
        for name, value in state.items():
            setattr(self, name, value)


class Aphynity(Objective):
    """APHYNITY (Yin et al. 2021; paper, section 2): minimise ‖F_a‖ subject to fitting the data.

    The Lagrangian is λ · L + ‖F_a‖, with L the mean squared error of the trajectory over the loss window and ‖F_a‖ the
    root mean square of F_a along the predicted trajectory, or at its states decorrelated
    (:func:`~expertaug.learning.expert_share.decorrelate`); after every ``every`` passes λ grows by tau2 · L (Yin's
    update).  Variants are the rows multiplier, penalty, loss_normalisation, loss_window and supervision of
    :mod:`expertaug.presets`.

    Arguments:
        lambda0: first multiplier, one for all seeds or one for each.
        tau2, every: size of its steps, passes between them.
        share: weight of what F_a says that another z_e would say as well, 0 for none: the mean square of that part, in
            units of the expert's rates (:mod:`expertaug.learning.expert_share`).
    """

    kept = ("multiplier", "first", "total", "count", "passes")

    def __init__(
        self,
        seeds: Sequence[int],
        choices: Choices,
        lambda0: float | Sequence[float] = 10.0,
        tau2: float = 5.0,
        every: int = 1,
        share: float = 0.0,
    ) -> None:
        super().__init__(seeds, choices)
        self.tau2, self.every, self.share = float(tau2), int(every), float(share)
        self.multiplier = torch.as_tensor(lambda0, dtype=torch.float32).expand(len(self.seeds)).clone()
        self.first = torch.ones(len(self.seeds))
        self.total = torch.zeros(len(self.seeds))
        self.count = self.passes = 0

    @property
    def _leaks(self) -> bool:
        return self.choices.loss_window == "half_batch"

    def window(self, task: Task) -> int:
        """Points that the loss compares at last: those of the task, or all times with the authors' slip."""
        return len(task.t) if self._leaks else task.horizon

    @torch.no_grad()
    def begin(self, model: HybridNet, batch: Batch, task: Task) -> None:
        """Take the data term's first value, by which the preset may divide it.

        It is that of the full window: that of the first two points would be little more than noise.
        """
        if self.choices.loss_normalisation == "first":
            posterior = model.encode(batch.windows(task.observed))
            first = self._terms(model, posterior, batch, task)[0].cpu()
            self.first = torch.where(torch.isfinite(first) & (first > 0), first, self.first)

    def loss(self, model: HybridNet, batch: Batch, task: Task) -> tuple[Tensor, dict[str, Tensor]]:
        """Loss (S,) and its parts, each (S,), without gradient."""
        posterior = model.encode(batch.windows(task.observed))
        data, penalty, runaways, share = self._terms(model, posterior, batch, task)
        loss = (self.multiplier / self.first).to(data.device, non_blocking=True) * data + penalty
        parts = {"data": data.detach(), "penalty": penalty.detach(), "multiplier": self.multiplier.clone()}
        parts["runaway_share"] = runaways
        if share is not None:
            loss = loss + self.share * share
            parts["expert_share"] = share.detach().sqrt()
        labelled, terms = supervised_terms(posterior, batch, task, self.choices.supervision)
        loss = loss if labelled is None else loss + labelled
        parts |= terms
        finite = data.detach().nan_to_num(0.0, 0.0, 0.0)  # one step must not raise the multiplier for ever
        self.total = self.total.to(data.device) + finite
        self.count += 1
        return loss, parts | {"loss": loss.detach()}

    def _terms(
        self, model: HybridNet, posterior: Posterior, batch: Batch, task: Task
    ) -> tuple[Tensor, Tensor, Tensor, Tensor | None]:
        """Data term and size of F_a over the first ``task.horizon`` points, share of runaways, and, where it counts,
        what F_a holds of the expert, each (S,)."""
        truth, (z_e, z_a), u = batch.y[: task.horizon], posterior.mean, batch.inputs(task.horizon)
        start = model.start(batch.windows(task.observed))
        if self._leaks:
            half = max(truth.shape[2] // 2, 1)
            truth, start, z_e, z_a = truth[:, :, :half], start[:, :half], z_e[:, :half], z_a[:, :half]
            u = None if u is None else u[:, :, :half]
        prediction, good = finite_forecast(model, start, z_e, z_a, task, task.horizon, u=u)
        data = mean_squared_error(model.system, prediction[1:], truth[1:], good, batch.complete)
        if model.interaction is None:
            return data, prediction.new_zeros(prediction.shape[1]), diverged_share(data, good), None
        choice, states = self.choices.penalty, prediction
        if choice == "norm_data":
            states = torch.where(torch.isnan(truth), prediction, truth)
        elif choice == "rms_mixed":
            states = decorrelate(prediction.detach())
        squares = model.interaction_squares(states, z_e, z_a, task.t[: task.horizon], u)
        if choice == "norm_data":
            penalty = torch.sqrt(squares * prod(model.system.state_shape) + 1e-12).flatten(1).mean(1)
        else:
            penalty = torch.sqrt(squares.flatten(1).mean(1) + 1e-12)
        share = None
        if self.share and any(p.requires_grad for p in model.interaction.parameters()):
            detached = prediction.detach(), z_e.detach(), z_a.detach(), task.t[: task.horizon]
            unit = expert_sizes(model.system, *detached[:2], detached[3], u)
            share = squares_beside_expert(model.decoder, *detached, unit, u)[1]
        return data, penalty, diverged_share(data, good), share

    def end_of_pass(self) -> None:
        """Raise the multiplier by tau2 times the passes' mean data term, when it is due."""
        self.passes += 1
        if self.passes % self.every == 0:
            if self.choices.multiplier == "lagrangian":
                self.multiplier = self.multiplier + self.tau2 * self.total.cpu() / max(self.count, 1)
            self.total, self.count = torch.zeros_like(self.total), 0

    def carried(self) -> dict:
        return {"lambda0": self.multiplier.tolist()}
