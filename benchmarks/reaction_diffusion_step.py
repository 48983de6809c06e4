"""A training step of stacked seeds on reaction–diffusion: `python benchmarks/reaction_diffusion_step.py`.

The plain way is one seed at a time, ordinary circular convolutions with z_a as constant channels; then this package's
interaction models, on the same encoder, data, batch size, loss and fixed grid, on one thread.  ``--layers`` prints what
one evaluation of F_a with its gradient takes for every way to compute the same three convolutions, ``--double`` what
one without a gradient takes in double precision, as refinement needs it.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable

os.environ["OMP_NUM_THREADS"] = "1"

import torch
from torch import Tensor, nn
from torch.nn.functional import conv2d

from expertaug import systems
from expertaug.learning.objectives import Aphynity
from expertaug.learning.settings import TrainSettings
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models.card import ModelCard
from expertaug.models.estimators import Hybrid
from expertaug.models.interactions.convolutional import ConvInteraction
from expertaug.models.networks.convolutional import wrap
from expertaug.presets import resolve
from expertaug.systems.settings import SimulatedData
from expertaug.systems.simulate import sample
from training_step import median_time

SYSTEM = {"name": "reaction_diffusion"}
POINTS, STEP = 11, 0.1
RANGES = {"z_e": {"a": [0.001, 0.002], "b": [0.003, 0.007]}, "z_a": {"k": [0.003, 0.005]}}
DATA = {"seed": 0, "step_s": STEP, "t2_s": 1.0, "noise": 0.0}
WAYS = {
    "3 × 3, float32": {"kind": "conv"},
    "3 × 3, bfloat16": {"kind": "conv", "precision": "bfloat16"},
    "3 × 3, then 1 × 1": {"kind": "conv", "kernels": [3, 1, 1]},
    "polynomial": {"kind": "polynomial"},
}


class UserInteraction(nn.Module):
    """F_a the ordinary way: z_a as constant channels, padding before every layer."""

    def __init__(self, system: systems.System, latent: int) -> None:
        super().__init__()
        widths = ((2 + latent, 16), (16, 16), (16, 2))
        self.layers = nn.ModuleList(nn.Conv2d(a, b, 3, padding=1, padding_mode="circular") for a, b in widths)

    def context(self, z_a: Tensor, z_e: Tensor) -> Tensor:
        """z_a itself."""
        return z_a

    def forward(self, y: Tensor, context: Tensor) -> Tensor:
        """One seed behind an axis of length one: (1, B, 2, H, W)."""
        constant = context[0, :, :, None, None].expand(-1, -1, *y.shape[-2:])
        hidden = torch.cat((y[0], constant), dim=1)
        for layer in self.layers[:-1]:
            hidden = torch.relu(layer(hidden))
        return self.layers[-1](hidden).unsqueeze(0)


def steps(seeds: list[int], data: StackedSet, batch_size: int, interaction: dict | None) -> Callable[[], None]:
    """One step of a group of seeds; with the plain interaction model where ``interaction`` is None."""
    system, t = systems.load(SYSTEM), [k * STEP for k in range(POINTS)]
    model = {"encoder": {"kind": "conv"}, "interaction": interaction or {"kind": "conv"}}
    card = ModelCard.of(
        kind="hybrid", system=systems.describe(system), model=model, t=list(t), observed=POINTS, seeds=list(seeds)
    )
    made = Hybrid.network(system, card)
    if interaction is None:
        made.decoder.interaction = UserInteraction(system, made.encoder.latent)
    made.encoder.fit(data.y[:, 0])
    objective, task = (
        Aphynity(seeds, resolve("corrected")),
        task_of(TrainSettings(), card, torch.device("cpu")),
    )
    batch = next(data.batches(seeds, 0, batch_size))
    optimiser = torch.optim.Adam(made.parameters())

    def step() -> None:
        optimiser.zero_grad()
        objective.loss(made, batch, task)[0].sum().backward()
        optimiser.step()

    return step


def layer_ways(seeds: int, batch_size: int) -> dict[str, Callable[[], None]]:
    """F_a with its gradient, for the ways to compute three circular convolutions."""
    model = ConvInteraction(systems.load(SYSTEM), 10)
    shapes = [model.state_layer.weight.shape, *(layer.weight.shape for layer in model.rest)]
    weights = [(0.1 * torch.randn(seeds, *shape)).requires_grad_() for shape in shapes]
    y = torch.rand(seeds, batch_size, 2, 32, 32, requires_grad=True)

    def each(x: Tensor, *kernels: Tensor) -> Tensor:
        for k, kernel in enumerate(kernels):
            x = conv2d(nn.functional.pad(x if k == 0 else x.relu_(), (1,) * 4, mode="circular"), kernel)
        return x

    def zero(x: Tensor, *kernels: Tensor) -> Tensor:
        for k, kernel in enumerate(kernels):
            x = conv2d(x if k == 0 else x.relu_(), kernel, padding=1)
        return x

    def once(x: Tensor, *kernels: Tensor, last: bool = True) -> Tensor:
        x = wrap(x, 3) if last else nn.functional.pad(x, (3,) * 4, mode="circular")
        for k, kernel in enumerate(kernels):
            x = conv2d(x if k == 0 else x.relu_(), kernel)
        return x

    def grouped(bfloat16: bool) -> Tensor:
        with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16):
            x = nn.functional.pad(y.transpose(0, 1).flatten(1, 2), (3,) * 4, mode="circular")
            for k, kernel in enumerate(weights):
                x = conv2d(x if k == 0 else x.relu_(), kernel.flatten(0, 1), groups=seeds)
        return x

    def loop(one: Callable, bfloat16: bool) -> Tensor:
        with torch.autocast("cpu", torch.bfloat16, enabled=bfloat16):
            return torch.stack([one(y[s], *(w[s] for w in weights)) for s in range(seeds)])

    def graded(forward: Callable[[], Tensor]) -> Callable[[], None]:
        return lambda: torch.autograd.grad(forward().float().sum(), [y, *weights])

    ways = {}
    for name, bfloat16 in (("float32", False), ("bfloat16", True)):
        for label, one in (
            ("circular padding in every layer", each),
            ("zero padding (another function)", zero),
            ("padded once, channels first", lambda x, *k: once(x, *k, last=False)),
            ("padded once, channels last", once),
        ):
            ways[f"{label}, {name}"] = graded(lambda one=one, b=bfloat16: loop(one, b))
        ways[f"padded once, grouped over seeds, {name}"] = graded(lambda b=bfloat16: grouped(b))
    return ways


def double_ways(samples: int) -> dict[str, Callable[[], None]]:
    """F_a in double precision: the default's two convolutions."""
    model = ConvInteraction(systems.load(SYSTEM), 1, channels=[16], kernels=[3, 1]).double().requires_grad_(False)
    y = torch.rand(samples, 2, 32, 32, dtype=torch.float64)
    context = model.context(torch.rand(samples, 1, dtype=torch.float64), torch.rand(samples, 2, dtype=torch.float64))
    first, last = model.state_layer.weight, model.rest[0]

    def usual() -> None:
        hidden = conv2d(nn.functional.pad(y, (1,) * 4, mode="circular"), first).add_(context[..., None, None])
        conv2d(hidden.relu_(), last.weight, last.bias)

    return {"torch's convolutions": usual, "products of matrices, in parts": lambda: model(y, context)}


def main() -> None:
    """Print a row per way and the ratio to the first."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--batch-size", type=int, default=20)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--layers", action="store_true")
    parser.add_argument("--double", action="store_true")
    options = parser.parse_args()
    torch.set_num_threads(1)
    seeds, size = list(range(options.seeds)), options.batch_size
    if options.double:
        ways, what = double_ways(options.seeds * size * 4), "an evaluation of F_a in double precision, fourfold,"
    elif options.layers:
        ways, what = layer_ways(options.seeds, size), "an evaluation of F_a with its gradient"
    else:
        data = SimulatedData.from_mapping(DATA | {"sets": {"train": RANGES | {"size": size}}})
        train = StackedSet.of(sample(systems.load(SYSTEM), data, "train"), torch.device("cpu"))
        plain = [steps([seed], train, size, None) for seed in seeds]
        ways = {"plain, one seed after another": lambda: [step() for step in plain]}
        ways |= {f"stacked, {name}": steps(seeds, train, size, way) for name, way in WAYS.items()}
        what = "a training step"
    base = None
    for name, step in ways.items():
        seconds = median_time(step, options.repeats)
        base = base or seconds
        print(f"{name:50s} {1e3 * seconds:7.1f} CPU ms, {seconds / base:.2f} of the first", flush=True)
    print(f"{what} of {options.seeds} seeds at batch {size}, one thread")


if __name__ == "__main__":
    main()
