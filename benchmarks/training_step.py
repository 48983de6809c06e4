"""A training step of stacked seeds against the usual way: `python benchmarks/training_step.py`.

The usual way is one seed at a time, ordinary layers (torch.nn.GRU, torch.nn.Linear) and torchdiffeq's dopri5 at a
tolerance of 1e-5.  The same architecture, data, batch size and loss (paper, appendix, damped pendulum) on one thread.
Ordinary modules may also be given to this package, which then calls them by torch.vmap, or one seed after the other
where a layer (torch.nn.GRU) has no rule for that; ``--vmap`` adds torch.vmap over the whole of the usual step.
``--device cuda`` takes the steps on a card, whose seconds are the clock's.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable, Mapping
from functools import partial
from itertools import pairwise

os.environ["OMP_NUM_THREADS"] = "1"

import torch
from torch import Tensor, nn
from torch.func import functional_call, stack_module_state, vmap
from torchdiffeq import odeint

from expertaug import systems
from expertaug.learning.objectives import Aphynity
from expertaug.learning.settings import TrainSettings
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models.card import ModelCard
from expertaug.models.hybrid import HybridModel, Part
from expertaug.models.store import device_of
from expertaug.presets import resolve
from expertaug.systems.settings import SimulatedData
from expertaug.systems.simulate import sample

POINTS, STEP = 51, 0.1
RANGES = {"z_e": {"omega0": [1.5, 3.1]}, "z_a": {"alpha": [0.0, 0.6]}}
TYPICAL = 2.2  # softplus of it is an ω0 amid the data, as after some training: dopri5 then needs its usual steps
DATA = {"seed": 0, "step_s": STEP, "t2_s": 20.0, "noise": 0.01}
AB5 = {"method": "ab5", "substeps": 2}  # as accurate as the fixed grid's rk4: tests/systems/solvers/test_adams.py
OURS = {"encoder": {"kind": "recurrent"}, "interaction": {"kind": "mlp"}}


def training_data(size: int = 1000, name: str = "train", device: str = "cpu") -> StackedSet:
    """The pendulum's set ``name``."""
    data = SimulatedData.from_mapping(DATA | {"sets": {name: RANGES | {"size": size}}})
    return StackedSet.of(sample(systems.load({"name": "pendulum"}), data, name), torch.device(device))


def mlp(*widths: int) -> nn.Sequential:
    """Fully connected layers with ReLU between them."""
    layers = [part for a, b in pairwise(widths) for part in (nn.Linear(a, b), nn.ReLU())]
    return nn.Sequential(*layers[:-1])


class UsualEncoder(nn.Module):
    """The encoder for one seed, as a user of this package writes it."""

    latent = 128

    def __init__(self) -> None:
        super().__init__()
        self.gru, self.head = nn.GRU(2, 128), mlp(128, 150, 150, 150, 1)

    def forward(self, observed: Tensor) -> tuple[Tensor, Tensor]:
        """(T1, B, 2) → z_e (B, 1), unbounded, and z_a (B, 128)."""
        z_a = self.gru(observed)[1][0]
        return self.head(z_a), z_a


class UsualInteraction(nn.Module):
    """F_a for one seed, likewise."""

    def __init__(self) -> None:
        super().__init__()
        self.f_a = mlp(130, 50, 50, 50, 2)

    def forward(self, y: Tensor, z_a: Tensor) -> Tensor:
        """(B, 2) and (B, 128) → (B, 2)."""
        return self.f_a(torch.cat((y, z_a), -1))


class UsualModel(nn.Module):
    """The paper's pendulum APHYNITY for one seed, written the usual way."""

    def __init__(self, seed: int, fused_gru: bool = True) -> None:
        super().__init__()
        torch.manual_seed(seed)
        self.gru = nn.GRU(2, 128) if fused_gru else nn.GRUCell(2, 128)
        self.head, self.f_a = mlp(128, 150, 150, 150, 1), mlp(130, 50, 50, 50, 2)
        nn.init.constant_(self.head[-1].bias, TYPICAL)

    def encode(self, y: Tensor) -> Tensor:
        """(T, B, 2) → (B, 128)."""
        if isinstance(self.gru, nn.GRU):
            return self.gru(y)[1][0]
        h = y.new_zeros(y.shape[1], 128)
        for point in y.unbind(0):  # nn.GRU cannot be vmapped; this is nn.GRUCell in plain operations
            inner, outer = point @ self.gru.weight_ih.T + self.gru.bias_ih, h @ self.gru.weight_hh.T + self.gru.bias_hh
            r_i, u_i, n_i = inner.chunk(3, -1)
            r_h, u_h, n_h = outer.chunk(3, -1)
            update = torch.sigmoid(u_i + u_h)
            h = torch.lerp(torch.tanh(n_i + torch.sigmoid(r_i + r_h) * n_h), h, update)
        return h

    def solve(self, y: Tensor, adaptive: bool = True) -> tuple[Tensor, Tensor]:
        """Forecast of a batch y (T, B, 2) over the observed window, and its F_a."""
        z_a = self.encode(y[:POINTS])
        omega0 = nn.functional.softplus(self.head(z_a))

        def field(t: Tensor, s: Tensor) -> Tensor:
            expert = torch.cat((s[..., 1:], -omega0.square() * torch.sin(s[..., :1])), -1)
            return expert + self.f_a(torch.cat((s, z_a), -1))

        t = torch.arange(POINTS, device=y.device) * STEP
        path = odeint(field, y[0], t, method="dopri5", rtol=1e-5, atol=1e-5) if adaptive else rk4(field, y[0], t)
        return path, self.f_a(torch.cat((path, z_a.expand(POINTS, *z_a.shape)), -1))

    def error(self, y: Tensor) -> Tensor:
        """Mean squared error of the forecast."""
        return (self.solve(y)[0][1:] - y[1:POINTS]).square().mean()

    def forward(self, y: Tensor, adaptive: bool = True) -> Tensor:
        """Loss: λ · mean squared error + root mean square of F_a."""
        path, f_a = self.solve(y, adaptive)
        return 10 * (path[1:] - y[1:POINTS]).square().mean() + f_a.square().mean().sqrt()


def rk4(field: Callable, y: Tensor, t: Tensor) -> Tensor:
    """torchdiffeq's fixed grid writes in place, which vmap refuses."""
    path = [y]
    for start in t[:-1]:
        k1 = field(start, y)
        k2 = field(start, y + STEP / 2 * k1)
        k3 = field(start, y + STEP / 2 * k2)
        k4 = field(start, y + STEP * k3)
        y = y + STEP / 6 * (k1 + 2 * (k2 + k3) + k4)
        path.append(y)
    return torch.stack(path)


def stacked_steps(seeds: int, data: StackedSet, solver: Mapping | None = None, **parts: Part) -> Callable[[], None]:
    """One step of all seeds the way this package does it, with its own parts but for those given."""
    system, t = systems.load({"name": "pendulum"}), [k * STEP for k in range(201)]
    group = list(range(seeds))
    card = ModelCard.of(kind="hybrid", system={"name": "pendulum"}, t=t, observed=POINTS, seeds=group)
    model = HybridModel(system, **(OURS | parts)).build(t[:POINTS], group)
    head = model.encoder.module.head[-1] if "encoder" in parts else model.encoder.head.layers[-1]
    nn.init.constant_(head.bias, TYPICAL)
    objective = Aphynity(group, resolve("corrected"))
    model, task = (
        model.to(data.y.device),
        task_of(TrainSettings.from_mapping({"solver": dict(solver or {})}), card, data.y.device),
    )
    batch = next(data.batches(group, 0, 100))
    optimiser = torch.optim.Adam(model.parameters())

    def step() -> None:
        optimiser.zero_grad()
        objective.loss(model, batch, task)[0].sum().backward()
        optimiser.step()

    return step


def usual_steps(seeds: int, data: StackedSet) -> Callable[[], None]:
    """One step of every seed, one after another."""
    models = [UsualModel(seed).to(data.y.device) for seed in range(seeds)]
    optimisers = [torch.optim.Adam(m.parameters()) for m in models]
    batches = [next(data.batches([seed], 0, 100)).y[:, 0] for seed in range(seeds)]

    def step() -> None:
        for model, optimiser, batch in zip(models, optimisers, batches, strict=True):
            optimiser.zero_grad()
            model(batch).backward()
            optimiser.step()

    return step


def vmapped_steps(seeds: int, data: StackedSet) -> Callable[[], None]:
    """One step of all seeds by torch.vmap over ordinary layers, on the same fixed grid as ours."""
    models = [UsualModel(seed, fused_gru=False).to(data.y.device) for seed in range(seeds)]
    parameters, _ = stack_module_state(models)
    optimiser = torch.optim.Adam(parameters.values())
    batches = torch.stack([next(data.batches([seed], 0, 100)).y[:, 0] for seed in range(seeds)])
    loss = vmap(lambda p, y: functional_call(models[0], p, (y, False)))

    def step() -> None:
        optimiser.zero_grad()
        loss(parameters, batches).sum().backward()
        optimiser.step()

    return step


def median_time(step: Callable[[], None], repeats: int, device: str = "cpu") -> float:
    """Median seconds of a step after one warm-up: of the processor, whose one thread hardly notices what else runs on
    the machine; of the clock where a card computes."""
    clock = time.process_time if device == "cpu" else _when_the_card_is_done
    step()
    times = []
    for _ in range(repeats):
        start = clock()
        step()
        times.append(clock() - start)
    return statistics.median(times)


def _when_the_card_is_done() -> float:
    torch.cuda.synchronize()
    return time.perf_counter()


def main() -> None:
    """Print a row per way and the ratio to the usual one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--repeats", type=int, default=7)
    parser.add_argument("--vmap", action="store_true")
    parser.add_argument("--device", choices=["cpu", "cuda"], default="cpu")
    options = parser.parse_args()
    device_of(options.device)  # one thread; says where there is no card
    data = training_data(device=options.device)
    ways = {
        "usual, dopri5 1e-5": usual_steps,
        "stacked, fixed grid": stacked_steps,
        "stacked, ab5 halved": partial(stacked_steps, solver=AB5),
        "own F_a, fixed grid": partial(stacked_steps, interaction=UsualInteraction),
        "own encoder and F_a": partial(stacked_steps, interaction=UsualInteraction, encoder=UsualEncoder),
    }
    if options.vmap:
        ways["torch.vmap, fixed grid"] = vmapped_steps
    base = None
    for name, make in ways.items():
        seconds = median_time(make(options.seeds, data), options.repeats, options.device)
        base = base or seconds
        unit = "CPU s" if options.device == "cpu" else "s"
        print(f"{name:24s} {seconds:.4g} {unit} a step of {options.seeds} seeds, {seconds / base:.2f} of the usual way")


if __name__ == "__main__":
    main()
