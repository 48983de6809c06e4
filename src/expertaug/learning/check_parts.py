"""What an encoder, an interaction model and an objective must give, checked before a training and where it is used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from expertaug.errors import InputError, SolveError
from expertaug.learning.objectives import Objective
from expertaug.learning.optimiser import Adam
from expertaug.learning.training_data import Batch, Task
from expertaug.models.hybrid import HybridModel, HybridNet
from expertaug.systems.inputs import check_trainable, solve
from expertaug.windows import Windows

SEEDS, SAMPLES = (0, 1), 4
TOLERANCE = 1e-3  # relative, of a seed alone and in a group: to float rounding


def check_loss(objective: object, loss: object, seeds: int) -> Tensor:
    """The loss of a group of seeds: one number a seed, (S,).

    Raises:
        InputError: it has another shape; a single number would divide every gradient by the number of seeds.
    """
    if not isinstance(loss, Tensor) or tuple(loss.shape) != (seeds,):
        actual = f"shape {tuple(loss.shape)}" if isinstance(loss, Tensor) else type(loss).__name__
        remedy = f"give one number for each seed, ({seeds},): average over all axes but the seeds'"
        raise InputError("objective", f"the loss of {type(objective).__name__} has {actual}", remedy)
    return loss


def check_parts(
    recipe: HybridModel,
    task: Task,
    objective: Callable[[list[int]], Objective] | None = None,
    samples: Windows | None = None,
    where: str = "model",
) -> None:
    """Make the networks of two seeds, call each part on a few samples, and take one step.

    Arguments:
        recipe: of the model.
        task: of the training.
        objective: makes it for a list of seeds; None: no step is taken.
        samples: y (T, N, *state) at the times of the task; forecasts of the expert alone without.
        where: file or key, for messages.

    Raises:
        InputError: the first mistake: class, what was found and what would be right.
    """
    check_trainable(recipe.system, where)
    seeds = list(SEEDS)
    first = objective(seeds) if objective is not None else None
    likelihood = first is not None and first.learns_likelihood
    times = task.t[: task.observed].double()

    def made(group: list[int]) -> HybridNet:
        model = recipe.build(times, group, likelihood)
        windows, name = samples.until(task.observed), _name(model.interaction)
        _call(lambda: model.encoder.fit(windows.joined), where, f"fit of {_name(model.encoder)}")
        _call(lambda: model.decoder.fit(windows.y), where, f"fit of {name}")
        return model

    samples = _samples(recipe, task) if samples is None else samples
    model = made(seeds).eval()
    batch = samples.with_seeds().expand(len(seeds))
    _check_encoder(model, batch.until(task.observed), where)
    _check_interaction(model, batch, where)
    _check_seeds(model, made(seeds[1:]).eval(), batch, task, where)
    _check_kept(model, recipe.build(times, seeds, likelihood), batch, task, where)
    if first is not None:
        _check_step(model.train(), first, batch, task, where)


def _samples(recipe: HybridModel, task: Task) -> Windows:
    """y (T, SAMPLES, *state): the expert's own motion from small random states, at typical parameters and inputs."""
    system = recipe.system
    generator = torch.Generator().manual_seed(0)
    y0 = torch.rand(SAMPLES, *system.state_shape, generator=generator)
    scale = torch.tensor([p.scale for p in system.expert_parameters])
    z_e = scale * (0.5 + torch.rand(SAMPLES, len(scale), generator=generator))
    scales, u = [p.scale for p in system.known], None
    if scales:
        u = torch.tensor(scales) * torch.rand(SAMPLES, len(scales), generator=generator).expand(len(task.t), -1, -1)
    with torch.no_grad():
        y = solve(system, lambda s, x, *more: system.expert(s, x, z_e, *more), y0, task.t, task.solver, z_e, u)
    return Windows(task.t, y, u)


def _check_encoder(model: HybridNet, observed: Windows, where: str) -> None:
    name, system = _name(model.encoder), model.system
    seeds, samples = observed.y.shape[1:3]
    with torch.no_grad():
        means, again = (_call(lambda: model.encode(observed).mean, where, name) for _ in range(2))
    sizes = len(system.expert_parameters), model.encoder.latent
    for part, mean, size in zip(("z_e", "z_a"), means, sizes, strict=True):
        _check_tensor(mean, (seeds, samples, size), where, f"{name}'s {part}")
    _check_same(means, again, where, name)
    positive = torch.tensor([p.positive for p in system.expert_parameters])
    if (means[0][..., positive] < 0).any():  # 0 is what a softplus far below it gives
        remedy = "return unbounded numbers, or use constrain"
        raise InputError(where, f"{name} gives a positive parameter a value that is not", remedy)


def _check_interaction(model: HybridNet, batch: Windows, where: str) -> None:
    if model.interaction is None:
        return
    name, lead = _name(model.interaction), batch.y.shape[1:3]
    z_e = torch.tensor([p.scale for p in model.system.expert_parameters]).expand(*lead, -1)
    z_a = torch.zeros(*lead, model.encoder.latent)

    def rates() -> Tensor:
        return _rates(model, batch, model.interaction.context(z_a, z_e))

    with torch.no_grad():
        first, again = (_call(rates, where, name) for _ in range(2))
    _check_tensor(first, tuple(batch.y[0].shape), where, f"{name}'s rates")
    _check_same((first,), (again,), where, name)


def _check_seeds(group: HybridNet, alone: HybridNet, batch: Windows, task: Task, where: str) -> None:
    """The last seed of a group must compute what it does alone."""
    together, single = (_outputs(model, y, task) for model, y in ((group, batch), (alone, batch.seed(slice(-1, None)))))
    for part, a, b in zip(_parts(group), together, single, strict=True):
        if not all(
            torch.allclose(x[-1], y[0], rtol=TOLERANCE, atol=TOLERANCE * _size(y)) for x, y in zip(a, b, strict=True)
        ):
            remedy = "keep what differs from seed to seed in parameters or buffers, made in its constructor"
            raise InputError(where, f"{part} gives a seed other values in a group than alone", remedy)


def _check_kept(model: HybridNet, other: HybridNet, batch: Windows, task: Task, where: str) -> None:
    """A model made anew from the state that a file holds must be the same."""
    other.load_state_dict(model.state_dict())
    for part, a, b in zip(_parts(model), *(_outputs(m, batch, task) for m in (model, other.eval())), strict=True):
        if not all(torch.equal(x, y) for x, y in zip(a, b, strict=True)):
            remedy = "register_buffer what fit or the constructor makes"
            raise InputError(where, f"{part} is another after it was saved and loaded", remedy)


def _check_step(model: HybridNet, objective: Objective, batch: Windows, task: Task, where: str) -> None:
    name = type(objective).__name__
    seeds, samples = batch.y.shape[1:3]
    z_e = torch.tensor([p.scale for p in model.system.expert_parameters]).expand(seeds, samples, -1)
    whole = Batch(batch, z_e, torch.zeros(seeds, samples))
    optimiser = Adam(model.parameters())

    def step() -> tuple[Tensor, dict]:
        objective.begin(model, whole, task)
        return objective.loss(model, whole, task)

    outcome = _call(step, where, name)
    if not isinstance(outcome, tuple) or len(outcome) != 2 or not isinstance(outcome[1], dict):
        raise InputError(
            where, f"{name}.loss gives {type(outcome).__name__}", "return the loss and a dict of its parts"
        )
    loss, parts = outcome
    check_loss(objective, loss, seeds)
    for key, value in [("loss", loss), *parts.items()]:
        if not isinstance(value, Tensor) or tuple(value.shape) != (seeds,):
            raise InputError(where, f"{name}.loss gives no ({seeds},) tensor for {key}", "one number for each seed")
        if not torch.isfinite(value).all():
            raise InputError(where, f"{name}.loss: its {key} is not finite", "check divisions and logarithms")
    if "loss" not in parts:
        raise InputError(where, f"{name}.loss gives no part called loss", "name the loss itself too: it is logged")
    if not loss.requires_grad:
        raise InputError(where, f"{name}.loss has no gradient", "detach the parts, not the loss")
    _call(lambda: loss.sum().backward(), where, name)
    for key, parameter in model.named_parameters():
        if parameter.grad is not None and not torch.isfinite(parameter.grad).all():
            raise InputError(where, f"the gradient of {name}.loss by {key} is not finite", "avoid √ and division at 0")
    before = [p.detach().clone() for p in model.parameters()]
    optimiser.step()
    if all(torch.equal(a, b) for a, b in zip(before, model.parameters(), strict=True)):
        raise InputError(where, f"a step of {name} changes no parameter", "let the loss depend on the model")


def _parts(model: HybridNet) -> list[str]:
    return [_name(part) for part in (model.encoder, model.interaction) if part is not None]


def _outputs(model: HybridNet, batch: Windows, task: Task) -> list[tuple[Tensor, ...]]:
    """What the encoder and the interaction model give, seeds first."""
    with torch.no_grad():
        z_e, z_a = model.encode(batch.until(task.observed)).mean
        outputs = [(z_e, z_a)]
        if model.interaction is not None:
            # The same latents for all: what the encoder gives has its own check.
            context = model.interaction.context(torch.zeros_like(z_a), torch.ones_like(z_e))
            outputs.append((_rates(model, batch, context),))
    return outputs


def _rates(model: HybridNet, batch: Windows, context: Tensor) -> Tensor:
    """F_a at the first states of a batch, (S, B, *state)."""
    u = None if batch.u is None else batch.u[0]
    return model.decoder.interaction_rate(batch.y[0], context, torch.zeros(()), u)


def _name(part: object) -> str:
    return type(getattr(part, "module", part)).__name__


def _size(tensor: Tensor) -> float:
    return max(float(tensor.abs().max()), 1e-12) if tensor.numel() else 1.0


def _call(call: Callable, where: str, name: str) -> Any:
    """What a part gives; any exception as one line."""
    try:
        return call()
    except (InputError, SolveError):
        raise
    except Exception as error:
        raise InputError(where, f"{name} fails ({type(error).__name__}: {error})", "correct the class") from error


def _check_tensor(tensor: object, shape: tuple[int, ...], where: str, name: str) -> None:
    if not isinstance(tensor, Tensor) or tuple(tensor.shape) != shape:
        actual = f"shape {tuple(tensor.shape)}" if isinstance(tensor, Tensor) else type(tensor).__name__
        raise InputError(where, f"{name}: {actual}", f"make it {shape}")
    if tensor.dtype != torch.float32:
        raise InputError(where, f"{name}: {tensor.dtype}", "compute in float32, as the samples are")
    if not torch.isfinite(tensor).all():
        raise InputError(where, f"{name}: a value is not finite", "check divisions and logarithms")


def _check_same(first: tuple, again: tuple, where: str, name: str) -> None:
    if not all(torch.equal(a, b) for a, b in zip(first, again, strict=True)):
        raise InputError(where, f"{name} gives other values when called twice", "leave random layers out")
