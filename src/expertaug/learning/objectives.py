"""Training objectives: one loss per seed and its named parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from expertaug.learning.sets import Batch
from expertaug.learning.task import Task
from expertaug.models.hybrid import HybridModel
from expertaug.models.posterior import Delta, Posterior
from expertaug.systems import System


def mean_squared_error(system: System, prediction: Tensor, truth: Tensor, good: Tensor | None = None) -> Tensor:
    """Mean over times, samples and dimensions of the squared error of observed quantities.

    Arguments:
        prediction, truth: (T, S, B, *state).
        good: (S, B), the samples that count; all of them where it is None.

    Returns:
        (S,).
    """
    error = (system.observe(prediction) - system.observe(truth)).square().movedim(1, 0)
    if good is None:
        return error.flatten(1).mean(1)
    each = error.movedim(2, 1).flatten(2).mean(2)
    return (each * good).sum(1) / good.sum(1).clamp_min(1)


def finite_forecast(
    model: HybridModel, y0: Tensor, z_e: Tensor, z_a: Tensor, task: Task, points: int
) -> tuple[Tensor, Tensor | None]:
    """A training batch's forecast (T, S, B, *state), and which samples (S, B) it holds for; None where for all.

    One sample whose speeds run away within a coarse step would make its seed's whole gradient NaN.  It is left out: it
    is solved again with its seed's mean latents, which carry no gradient, and does not count.
    """
    prediction = model.forecast(y0, z_e, z_a, task.t[:points], task.solver)
    good = torch.isfinite(prediction).movedim(0, 2).flatten(2).all(-1)
    if good.all():
        return prediction, None
    weight = good.unsqueeze(-1)

    def replaced(z: Tensor) -> Tensor:
        mean = (z.detach().nan_to_num() * weight).sum(1, keepdim=True) / weight.sum(1, keepdim=True).clamp_min(1)
        return torch.where(weight, z, mean)

    return model.forecast(y0, replaced(z_e), replaced(z_a), task.t[:points], task.solver), good


class Aphynity:
    """APHYNITY (Yin et al. 2021; paper, section 2): minimise ‖F_a‖ subject to fitting the data.

    The Lagrangian is λ · L + ‖F_a‖, with L the mean squared error of the trajectory over the loss window and ‖F_a‖ the
    root mean square of F_a along the predicted trajectory; after every ``every`` passes λ grows by tau2 · L (Yin's
    update).  Variants are the rows multiplier, penalty, loss_normalisation, loss_window and supervision of
    :mod:`expertaug.presets`.

    Arguments:
        seeds: S, number of seeds in the block.
        lambda0: first multiplier, one for all seeds or one for each.
        tau2, every: size of its steps, passes between them.
        choices: rows of the preset.
    """

    def __init__(
        self,
        seeds: int,
        choices: Mapping,
        lambda0: float | Sequence[float] = 10.0,
        tau2: float = 5.0,
        every: int = 1,
    ) -> None:
        self.choices = choices
        self.tau2, self.every = float(tau2), int(every)
        self.multiplier = torch.as_tensor(lambda0, dtype=torch.float32).expand(seeds).clone()
        self.first = torch.zeros(seeds)
        self.total = torch.zeros(seeds)
        self.count = self.passes = 0

    def loss(self, model: HybridModel, batch: Batch, task: Task) -> tuple[Tensor, dict[str, Tensor]]:
        """Loss (S,) and its parts, each (S,), without gradient."""
        y, points = batch.y, task.horizon
        posterior = model.encode(y[: task.observed])
        z_e, z_a = posterior.rsample()
        if self.choices["loss_window"] == "half_batch":
            half = max(y.shape[2] // 2, 1)
            points, truth = len(task.t), y[:, :, :half]
            start, z_e_used, z_a_used = y[0][:, :half], z_e[:, :half], z_a[:, :half]
        else:
            truth, start, z_e_used, z_a_used = y[:points], y[0], z_e, z_a
        prediction, good = finite_forecast(model, start, z_e_used, z_a_used, task, points)
        data = mean_squared_error(model.system, prediction[1:], truth[1:points], good)
        penalty = self._penalty(model, prediction, truth[:points], z_e_used, z_a_used)
        loss = self._weight(data) * data + penalty
        parts = {"data": data.detach(), "penalty": penalty.detach(), "multiplier": self.multiplier.clone()}
        supervised = batch.supervised.sum(1)
        if self.choices["supervision"] != "off" and supervised.any():
            term = self._supervision(posterior, batch, task) / supervised.clamp_min(1)
            loss = loss + task.supervision_weight * term
            parts["z_e"] = term.detach()
        self.total += data.detach().cpu()
        self.count += 1
        return loss, parts | {"loss": loss.detach()}

    def _weight(self, data: Tensor) -> Tensor:
        if self.choices["loss_normalisation"] == "first":
            self.first = torch.where(self.first == 0, data.detach().cpu(), self.first)
            return (self.multiplier / self.first).to(data.device)
        return self.multiplier.to(data.device)

    def _penalty(self, model: HybridModel, prediction: Tensor, truth: Tensor, z_e: Tensor, z_a: Tensor) -> Tensor:
        if model.interaction is None:
            return prediction.new_zeros(prediction.shape[1])
        dims = len(model.system.state)
        if self.choices["penalty"] == "norm_data":
            size = model.interaction_squares(truth, z_e, z_a) * dims
            return torch.sqrt(size + 1e-12).flatten(1).mean(1)
        return torch.sqrt(model.interaction_squares(prediction, z_e, z_a).flatten(1).mean(1) + 1e-12)

    def _supervision(self, posterior: Posterior, batch: Batch, task: Task) -> Tensor:
        if self.choices["supervision"] == "raw":
            return ((posterior.z_e.mean - batch.z_e).square().sum(-1) * batch.supervised).sum(1)
        density = Delta(posterior.z_e.mean, task.z_e_scale).log_prob(batch.z_e)
        return -(density * batch.supervised).sum(1)

    def end_of_pass(self) -> None:
        """Raise the multiplier by tau2 times the passes' mean data term, when it is due."""
        self.passes += 1
        if self.passes % self.every == 0:
            if self.choices["multiplier"] == "lagrangian":
                self.multiplier = self.multiplier + self.tau2 * self.total / max(self.count, 1)
            self.total, self.count = torch.zeros_like(self.total), 0

    def state(self) -> dict:
        """What a checkpoint keeps."""
        return {name: getattr(self, name) for name in ("multiplier", "first", "total", "count", "passes")}

    def restore(self, state: Mapping) -> None:
        """Take up what :meth:`state` gave."""
        for name, value in state.items():
            setattr(self, name, value)
