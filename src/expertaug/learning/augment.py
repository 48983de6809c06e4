"""Expert augmentation of a trained model (paper, Algorithm 1, GenerateAugmentedSet), and the stage augment."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError
from expertaug.learning.divergence import clamp_to_bound, forecast_or_fallback, within_bound
from expertaug.learning.random_streams import RandomStreams
from expertaug.learning.settings import AugmentJob
from expertaug.learning.training_data import StackedSet, Task, set_files, task_of
from expertaug.models import store
from expertaug.models.hybrid import HybridNet
from expertaug.models.observation_noise import GivenNoise, NoiseLike, noise_of, shape_as_state
from expertaug.models.posterior import Gaussian, Normal, Posterior
from expertaug.models.store import device_of
from expertaug.models.tensor_file import read_tensors, write_tensors
from expertaug.presets import Choices
from expertaug.settings import given_ranges
from expertaug.systems import System
from expertaug.trajectories import Trajectories
from expertaug.windows import Windows

logger = logging.getLogger(__name__)
CHUNK, NUMBERS = 4096, 2**20  # samples simulated at a time, and numbers in their states: bounds the memory
ATTEMPTS = 10
TRIED = 512  # windows by which the hardest z_e are found
NEAR = 0.05  # of p⁺'s width: the neighbourhood of a hard z_e


@dataclass(frozen=True)
class Drawing:
    """How augmented samples are drawn.

    Attributes:
        prior: ranges of p⁺ by expert parameter.
        noise: standard deviation of the noise added to every point, the first one too; of each component, where there
            are several.
        seeds: in the group's order; samples depend on the seed and the number of the draw alone.
        resample_x: whether x is drawn anew (:meth:`System.resample_known`) instead of taken from the data.
        z_a_from: posterior: a sample of q(z_a | x, y); prior: of N(0, I), where the posterior is not a point.
        worst: share of the samples whose z_e are drawn where the model's own estimates are bad
            (:func:`hardest_parameters`) instead of uniformly; with 0 the samples have the same bits as without it.
    """

    prior: Mapping[str, Sequence[float]]
    noise: NoiseLike
    seeds: Sequence[int]
    resample_x: bool = False
    z_a_from: str = "posterior"
    worst: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """What a file of samples says."""
        options = {"resample_x": self.resample_x, "z_a_from": self.z_a_from}
        options |= {"worst": self.worst} if self.worst else {}
        prior = {name: list(ends) for name, ends in self.prior.items()}
        return {"prior": prior, "noise": self.noise, "seeds": list(self.seeds), "options": options}

    @classmethod
    def of_json(cls, header: Mapping[str, Any]) -> Drawing:
        """As a file says."""
        return cls(header["prior"], header["noise"], header["seeds"], **header["options"])


@dataclass(frozen=True)
class Augmented:
    """Augmented samples of every seed.

    Attributes:
        train, validation: y (T, S, N, *state), z_e (S, N, P); the second selects in fine-tuning.
        drawing: how they were drawn.
    """

    train: StackedSet
    validation: StackedSet
    drawing: Drawing


def run_stage(model: Path, data: Path, output: Path, job: AugmentJob) -> None:
    """Stage: draw D⁺ for every seed of a trained model, and an augmented validation set that selects in fine-tuning.

    Arguments:
        model: file of the trained model.
        data: folder of the sets.
        output: file of D⁺.
        job: its settings.
    """
    stored = store.load(model, device_of(job.device), job.classes or ())
    train, validation = map(Trajectories.load, set_files(data))
    prior = given_ranges(job.prior)
    save(output, augment(stored, train, validation, prior, job.noise, job.choices, job.worst, model))


def augment(
    stored: store.StoredModel,
    train: Trajectories,
    validation: Trajectories,
    prior: Mapping[str, Sequence[float]],
    noise: GivenNoise,
    choices: Choices,
    worst: float = 0.0,
    where: object = "augmentation",
) -> Augmented:
    """Draw D⁺ (paper, Algorithm 1); the model stays as it is.

    Arguments:
        stored: a trained hybrid model.
        train, validation: whose x and observed windows are used.
        prior: ranges of p⁺.
        noise: standard deviation of the data's noise.
        choices: rows of the preset.
        worst: as of :class:`Drawing`.
        where: for messages.

    Raises:
        InputError: the model is a baseline, or the prior does not name its expert parameters.
        SolveError: samples are not finite for any z_e drawn.
    """
    device = stored.device
    if not stored.kind.has_objective:
        raise InputError(where, f"a {stored.card.kind} model", "only hybrid models can be augmented")
    task = task_of(stored.card.training, stored.card, device)
    short = task.shortened(task.points(choices))
    added: NoiseLike = 0.0
    if choices.augmentation_noise == "as_data":
        added = noise_of(noise, stored.model.system, stored.card)
    resampled, z_a_from = choices.augmented_x == "resampled", choices.augmented_z_a
    drawing = Drawing(prior, added, stored.seeds, resampled, z_a_from, float(worst))
    long = task if choices.augmented_selection == "forecast" else short
    plus, plus_validation = (
        generate(stored.model, StackedSet.of(part, device, len(until.t)), until, drawing, number)
        for number, (part, until) in enumerate(((train, short), (validation, long)))
    )
    return Augmented(plus, plus_validation, drawing)


def prior_ends(system: System, prior: Mapping[str, Sequence[float]]) -> tuple[Tensor, Tensor]:
    """Lower and upper ends (P,) of the uniform augmentation prior p⁺(z_e).

    Raises:
        InputError: the ranges are not those of the system's expert parameters.
    """
    names = [p.name for p in system.expert_parameters]
    if sorted(prior) != sorted(names):
        raise InputError("augmentation.prior", f"ranges for {sorted(prior)}", f"give one for each of {names}")
    low, high = (torch.tensor([float(prior[n][end]) for n in names]) for end in (0, 1))
    return low, high


def prior_scale(model: HybridNet, prior: Mapping[str, Sequence[float]]) -> Tensor:
    """Standard deviation (P,) of p⁺."""
    low, high = prior_ends(model.system, prior)
    return (high - low) / 12**0.5


@torch.no_grad()
def generate(
    model: HybridNet,
    data: StackedSet,
    task: Task,
    drawing: Drawing,
    number: int,
) -> StackedSet:
    """One augmented sample for each of ``data``: x from the data, z_a ~ q(z_a | x, y), z_e ~ p⁺, y by the model.

    What all windows share is not drawn: it is the model's constant.

    Arguments:
        model: stacked, trained; it is not changed.
        data: (T, 1, N, *state); only its observed window is used.
        task: of the training: ``t``, ``observed`` and ``solver``.
        drawing: how to draw.
        number: of the draw (sets, passes).

    Returns:
        y (T, S, N, *state), NaN where the sample that it came from has a gap, z_e (S, N, P), all supervised, z_a
        (S, N, Q), with the known inputs of the data.  z_e is drawn again for a sample that runs away
        (:mod:`expertaug.learning.divergence`); where that does not help either, another sample of its seed stands in
        its place, and a warning tells how many these are.
    """
    seeds, noise = drawing.seeds, drawing.noise
    low, high = prior_ends(model.system, drawing.prior)
    random = RandomStreams(seeds, number, 1, device=data.y.device)
    hard = hardest_parameters(model, data, task, drawing, number) if drawing.worst else None
    lost = torch.zeros(len(seeds), dtype=torch.long)
    parts, size = [], max(min(CHUNK, NUMBERS // data.y[0, 0, 0].numel()), 1)
    for start in range(0, len(data), size):
        index = torch.arange(start, min(start + size, len(data)))
        batch = data.at(index).whole(len(seeds))
        windows, u = batch.windows(task.observed), batch.inputs(len(task.t))
        y0 = model.start(windows)
        z_a = sample_latent(model.encode(windows), drawing.z_a_from, partial(random.normal, len(index)))
        if drawing.resample_x:
            y0 = model.system.resample_known(y0, partial(random.uniform, len(index)))
        y, z_e = _simulate(model, y0, z_a, low, high, task, random, u, hard, drawing.worst)
        good = within_bound(y, task.bound)
        for _ in range(ATTEMPTS):
            if good.all():
                break
            again, other = _simulate(model, y0, z_a, low, high, task, random, u)
            y = torch.where(good.view(1, *good.shape, *[1] * (y.dim() - 3)), y, again)
            z_e = torch.where(good.unsqueeze(-1), z_e, other)
            good = within_bound(y, task.bound)
        else:
            y, z_e, z_a, u = _replace_diverged(y, z_e, z_a, u, good, task)
            lost += (~good).sum(1).cpu()
        parts.append((_as_measured(y, batch.y), z_e, z_a, u))
    for seed, count in zip(seeds, lost.tolist(), strict=True):
        if count:
            logger.warning(
                "augmentation, seed %d: %d of %d samples (%.1f %%) ran away for every z_e drawn and were replaced; "
                "consider a narrower augmentation.prior", seed, count, len(data), 100 * count / len(data),
            )  # fmt: skip
    y, z_e, z_a = (torch.cat([p[k] for p in parts], dim=2 if k == 0 else 1) for k in range(3))
    if noise:
        y = y + shape_as_state(noise, y, model.system) * random.normal(len(y), *y.shape[2:]).movedim(0, 1)
    u = None if data.u is None else torch.cat([p[3] for p in parts], dim=2)
    made = Windows(task.t, y, u)
    return StackedSet(made, z_e, torch.ones(z_e.shape[1], device=y.device), z_a)


def _as_measured(y: Tensor, like: Tensor) -> Tensor:
    """States y (T, S, N, *state) with the gaps of others: an encoder is to learn from windows such as it will get."""
    gaps = torch.isnan(like[: len(y)])
    if not gaps.any():
        return y
    y = y.clone()
    y[: len(gaps)] = y[: len(gaps)].masked_fill(gaps, torch.nan)
    return y


@torch.no_grad()
def hardest_parameters(
    model: HybridNet,
    data: StackedSet,
    task: Task,
    drawing: Drawing,
    number: int,
) -> Tensor:
    """z_e (S, M, P) of p⁺ where the model's own estimates are worst: the hardest quarter of a uniform trial.

    Windows are simulated from the first of ``data``, with z_e of the whole range, and estimated; how bad an estimate is
    is the error of z_e in the range's widths, the largest over parameters.  Arguments are those of :func:`generate`.
    """
    random = RandomStreams(drawing.seeds, number, 5, device=data.y.device)
    low, high = prior_ends(model.system, drawing.prior)
    batch = data.at(torch.arange(TRIED, device=data.y.device) % len(data)).whole(len(drawing.seeds))
    windows, u = batch.windows(task.observed), batch.inputs(task.observed)
    z_a = sample_latent(model.encode(windows), "posterior", partial(random.normal, TRIED))
    y, z_e = _simulate(model, model.start(windows), z_a, low, high, task.shortened(task.observed), random, u)
    y = clamp_to_bound(y, task.bound)
    y = y + shape_as_state(drawing.noise, y, model.system) * random.normal(len(y), *y.shape[2:]).movedim(0, 1)
    estimated = model.encode(Windows(windows.t, _as_measured(y, batch.y), u)).z_e.mean
    width = (high - low).clamp_min(1e-12).to(y)
    error = ((estimated - z_e) / width).abs().amax(-1).nan_to_num(torch.inf)
    hardest = error.topk(max(TRIED // 4, 1), dim=1).indices
    return z_e.gather(1, hardest.unsqueeze(-1).expand(-1, -1, z_e.shape[-1]))


def sample_latent(posterior: Posterior, z_a_from: str, normal: Normal) -> Tensor:
    """z_a (…, B, Q): a sample of a posterior, or of N(0, I) where ``z_a_from`` says prior and it is not a point."""
    if z_a_from == "prior" and isinstance(posterior.z_a, Gaussian):
        return normal(posterior.z_a.loc.shape[-1])
    return posterior.z_a.draw(normal)  # type: ignore[attr-defined]


def _simulate(
    model: HybridNet,
    y0: Tensor,
    z_a: Tensor,
    low: Tensor,
    high: Tensor,
    task: Task,
    random: RandomStreams,
    u: Tensor | None,
    hard: Tensor | None = None,
    worst: float = 0.0,
) -> tuple[Tensor, Tensor]:
    z_e = low.to(y0) + (high - low).to(y0) * random.uniform(y0.shape[1], len(low))
    if hard is not None:
        index = (random.uniform(y0.shape[1]) * hard.shape[1]).long().clamp_max(hard.shape[1] - 1)
        near = hard[torch.arange(len(hard), device=hard.device).unsqueeze(1), index]
        near = near + NEAR * (high - low).to(y0) * (random.uniform(y0.shape[1], len(low)) - 0.5)
        chosen = random.uniform(y0.shape[1], 1) < worst
        z_e = torch.where(chosen, near.clamp(low.to(y0), high.to(y0)), z_e)
    z_e = model.held(z_e)
    return forecast_or_fallback(model, y0, z_e, z_a, task.t, task.solver, u), z_e


def _replace_diverged(
    y: Tensor, z_e: Tensor, z_a: Tensor, u: Tensor | None, good: Tensor, task: Task
) -> tuple[Tensor, Tensor, Tensor, Tensor | None]:
    """Samples y (T, S, N, *state), z_e (S, N, P), z_a (S, N, Q), u (T, S, N, U) with those that are not good (S, N)
    replaced by the good sample of their seed that follows, in a circle; where a seed has none, its trajectories are cut
    off at the bound."""
    u, z_a = None if u is None else u.clone(), z_a.clone()
    y = clamp_to_bound(y, task.bound).nan_to_num(0.0, 0.0, 0.0)
    index = torch.arange(good.shape[1], device=y.device)
    for place in good.any(1).nonzero().flatten().tolist():
        fine = good[place].nonzero().flatten()
        chosen = fine[torch.searchsorted(fine, index) % len(fine)]
        y[:, place], z_e[place], z_a[place] = y[:, place, chosen], z_e[place, chosen], z_a[place, chosen]
        if u is not None:
            u[:, place] = u[:, place, chosen]
    return y, z_e, z_a, u


def save(path: Path, plus: Augmented) -> None:
    """Write augmented samples."""
    tensors = {}
    for name, part in (("train", plus.train), ("validation", plus.validation)):
        tensors |= {f"{name}_y": part.y, f"{name}_z_e": part.z_e}
        tensors |= {} if part.u is None else {f"{name}_u": part.u.contiguous()}
        tensors |= {} if part.z_a is None else {f"{name}_z_a": part.z_a.contiguous()}
    write_tensors(path, tensors, plus.drawing.to_json())


def load(path: Path, device: torch.device, t: Tensor) -> Augmented:
    """Read what :func:`save` wrote; ``t`` (T,) are the model's times in s."""
    header, tensors = read_tensors(path)
    sets = []
    for name in ("train", "validation"):
        y, z_e = tensors[f"{name}_y"].to(device), tensors[f"{name}_z_e"].to(device)
        u, z_a = (tensors[f"{name}_{k}"].to(device) if f"{name}_{k}" in tensors else None for k in ("u", "z_a"))
        made = Windows(t[: len(y)], y, u)
        sets.append(StackedSet(made, z_e, torch.ones(z_e.shape[1], device=device), z_a))
    return Augmented(sets[0], sets[1], Drawing.of_json(header))
