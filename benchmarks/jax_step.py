"""A training step of the default pendulum's APHYNITY here and in plain JAX: `python benchmarks/jax_step.py`.

JAX is no dependency of the package: `pip install jax` beside it.  The same networks, batch, loss, solver
(Adams–Bashforth of fifth order in half steps, begun by Runge–Kutta steps) and optimiser; there jit over lax.scan, and
lax.map over seeds.  Ways take turns; times are CPU seconds of the process, on one thread, medians of the turns;
compiling is printed apart.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable

os.environ |= {
    "OMP_NUM_THREADS": "1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    "JAX_PLATFORMS": "cpu",
}

import torch

from expertaug import systems
from expertaug.learning.objectives import Aphynity
from expertaug.learning.settings import TrainSettings
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models.card import ModelCard
from expertaug.models.hybrid import HybridModel
from expertaug.models.store import device_of
from expertaug.presets import resolve
from training_step import AB5, POINTS, STEP, TYPICAL, training_data

try:
    import jax
    import jax.numpy as jnp
    from jax import lax, random
except ImportError:
    sys.exit("jax_step: jax is not installed; pip install jax")

BATCH, LAMBDA, RATE = 100, 10.0, 1e-3
ENCODER = {
    "kind": "window",
    "windows": {"theta": [0.0, 5.0], "omega": [0.0, 5.0]},
    "layers": [300, 300, 300],
    "latent": 1,
    "activation": "silu",
}
INTERACTION = {"kind": "mlp", "layers": [16, 16], "activation": "silu", "components": ["omega"]}
AB = (1901 / 720, -2774 / 720, 2616 / 720, -1274 / 720, 251 / 720)
H = STEP / AB5["substeps"]


def ours(seeds: int, data: StackedSet) -> Callable[[], None]:
    """One step of all seeds by this package."""
    group, t = list(range(seeds)), [k * STEP for k in range(201)]
    card = ModelCard.of(kind="hybrid", system={"name": "pendulum"}, t=t, observed=POINTS, seeds=group)
    model = HybridModel(systems.load({"name": "pendulum"}), ENCODER, INTERACTION).build(t[:POINTS], group)
    objective, batch = Aphynity(group, resolve("corrected")), next(data.batches(group, 0, BATCH))
    task = task_of(TrainSettings.from_mapping({"solver": AB5}), card, data.y.device)
    optimiser = torch.optim.Adam(model.parameters(), lr=RATE)

    def step() -> None:
        optimiser.zero_grad()
        objective.loss(model, batch, task)[0].sum().backward()
        optimiser.step()

    return step


def network(key: jax.Array, widths: list[int]) -> list[tuple[jax.Array, jax.Array]]:
    """Weights and biases of a fully connected network."""
    keys = random.split(key, len(widths) - 1)
    pairs = zip(keys, widths[:-1], widths[1:], strict=True)
    return [(random.uniform(k, (a, b), minval=-(a**-0.5), maxval=a**-0.5), jnp.zeros(b)) for k, a, b in pairs]


def apply(layers: list[tuple[jax.Array, jax.Array]], x: jax.Array) -> jax.Array:
    """The network's output, silu between its layers."""
    for weight, bias in layers[:-1]:
        x = jax.nn.silu(x @ weight + bias)
    return x @ layers[-1][0] + layers[-1][1]


def loss(parameters: dict, y: jax.Array) -> jax.Array:
    """λ · mean squared error of the forecast of y (T, B, 2) and the root mean square of F_a."""
    seen = y[:POINTS].transpose(1, 2, 0).reshape(y.shape[1], -1)
    z = apply(parameters["encoder"], seen)
    omega0, z_a = jax.nn.softplus(z[:, :1] + TYPICAL), z[:, 1:]

    def f_a(s: jax.Array) -> jax.Array:
        return apply(parameters["interaction"], jnp.concatenate((s, z_a), -1))

    def field(s: jax.Array) -> jax.Array:
        return jnp.concatenate((s[:, 1:], -(omega0**2) * jnp.sin(s[:, :1]) + f_a(s)), -1)

    def begin(s: jax.Array, _: None) -> tuple[jax.Array, tuple[jax.Array, jax.Array]]:
        k1 = field(s)
        k2 = field(s + H / 2 * k1)
        k3 = field(s + H / 2 * k2)
        new = s + H / 6 * (k1 + 2 * (k2 + k3) + field(s + H * k3))
        return new, (new, k1)

    def go_on(carry: tuple[jax.Array, jax.Array], _: None) -> tuple[tuple[jax.Array, jax.Array], jax.Array]:
        s, rates = carry
        rates = jnp.concatenate((field(s)[None], rates[:-1]))
        new = s + H * jnp.tensordot(jnp.array(AB), rates, 1)
        return (new, rates), new

    steps = AB5["substeps"] * (POINTS - 1)
    s, (first, rates) = lax.scan(begin, y[0], None, length=4)
    rates = jnp.concatenate((rates[::-1], jnp.zeros_like(rates[:1])))
    _, rest = lax.scan(go_on, (s, rates), None, length=steps - 4)
    path = jnp.concatenate((first, rest))[AB5["substeps"] - 1 :: AB5["substeps"]]
    size = jax.vmap(f_a)(path)
    return LAMBDA * jnp.mean((path - y[1:POINTS]) ** 2) + jnp.sqrt(jnp.mean(size**2))


@jax.jit
def updated(state: tuple, y: jax.Array) -> tuple:
    """Parameters and Adam's moments of all seeds after one step; y (S, T, B, 2)."""

    def one(given: tuple) -> tuple:
        (parameters, first, second, count), batch = given
        slope = jax.grad(loss)(parameters, batch)
        count = count + 1
        first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, first, slope)
        second = jax.tree.map(lambda v, g: 0.999 * v + 0.001 * g * g, second, slope)

        def moved(p: jax.Array, m: jax.Array, v: jax.Array) -> jax.Array:
            return p - RATE * (m / (1 - 0.9**count)) / (jnp.sqrt(v / (1 - 0.999**count)) + 1e-8)

        return jax.tree.map(moved, parameters, first, second), first, second, count

    return lax.map(one, (state, y))


def in_jax(seeds: int, data: StackedSet) -> Callable[[], None]:
    """One step of all seeds in JAX."""

    def made(key: jax.Array) -> dict:
        a, b = random.split(key)
        return {"encoder": network(a, [2 * POINTS, 300, 300, 300, 2]), "interaction": network(b, [3, 16, 16, 1])}

    parameters = jax.vmap(made)(random.split(random.key(0), seeds))
    zeros = jax.tree.map(jnp.zeros_like, parameters)
    state = parameters, zeros, zeros, jnp.zeros(seeds)
    y = jnp.stack([jnp.asarray(next(data.batches([seed], 0, BATCH)).y[:, 0].numpy()) for seed in range(seeds)])

    def step() -> None:
        nonlocal state
        state = jax.block_until_ready(updated(state, y))

    return step


def timed(step: Callable[[], None], times: int) -> float:
    """CPU milliseconds of a step, of so many in a row."""
    begin = time.process_time()
    for _ in range(times):
        step()
    return 1000 * (time.process_time() - begin) / times


def main() -> None:
    """Print a line for each number of seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 3, 10])
    parser.add_argument("--turns", type=int, default=7)
    parser.add_argument("--steps", type=int, default=10, help="in a turn")
    options = parser.parse_args()
    device_of("cpu")  # one thread
    data = training_data()
    for seeds in options.seeds:
        ways = {"here": ours(seeds, data), "JAX": in_jax(seeds, data)}
        begin = time.process_time()
        ways["JAX"]()
        compiling = time.process_time() - begin
        ways["here"]()
        turns = [{name: timed(step, options.steps) for name, step in ways.items()} for _ in range(options.turns)]
        here, there = (statistics.median(turn[name] for turn in turns) for name in ways)
        told = f"JAX {there:.1f} ms (compiled in {compiling:.1f} s), here / JAX {here / there:.2f}"
        print(f"{seeds} seeds: here {here:.1f} ms, {told}", flush=True)


if __name__ == "__main__":
    main()
