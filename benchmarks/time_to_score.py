"""How long ten seeds take to a given validation score: ``python benchmarks/time_to_score.py`` (a quarter of an hour).

The baseline is the usual way of benchmarks/training_step.py with the paper's constant learning rate of 5e-4 and its
2,500 steps.  It runs seed after seed, so ``--baseline-seeds`` of them are measured and their time is scaled to ten (the
score is their mean).  Ours trains ten stacked seeds on a one-cycle schedule and is timed until the mean of its seeds'
best validation scores passes the baseline's final one.  The score of both is the log mean squared error of the forecast
over [t0, t1] on the validation set; the time spent on computing scores counts for neither.
"""

from __future__ import annotations

import argparse
import math
import time

import torch

from expertaug import systems
from expertaug.learning.objectives import Aphynity
from expertaug.learning.sets import StackedSet
from expertaug.learning.task import task_of
from expertaug.learning.trainer import Trainer, TrainSettings
from expertaug.models import store
from expertaug.presets import resolve
from training_step import MODEL, POINTS, STEP, UsualModel, training_data


def baseline(seed: int, train: StackedSet, validation: StackedSet, steps: int) -> tuple[float, float]:
    """CPU seconds and final validation score of one seed."""
    model, y = UsualModel(seed), validation.y[:POINTS, 0]
    optimiser = torch.optim.Adam(model.parameters(), lr=5e-4)
    start = time.process_time()
    for done in range(steps):
        if done % train.steps(100) == 0:
            batches = train.batches([seed], done, 100)
        optimiser.zero_grad()
        model(next(batches).y[:, 0]).backward()
        optimiser.step()
    seconds = time.process_time() - start
    with torch.no_grad():
        return seconds, math.log(float(model.error(y)))


def ours(seeds: int, train: StackedSet, validation: StackedSet, epochs: int, target: float) -> tuple[float, float]:
    """CPU seconds until the mean best score passes ``target`` (infinite if it never does) and the last score."""
    description = {"model": MODEL, "t": [k * STEP for k in range(201)], "observed": POINTS, "seeds": list(range(seeds))}
    model = store.make(systems.load({"name": "pendulum"}), description | {"expert": True, "interaction": True})
    task = task_of({}, description, torch.device("cpu"))
    settings = TrainSettings(epochs=epochs, batch_size=100, learning_rate=3e-3)
    trainer = Trainer(
        model,
        Aphynity(seeds, resolve("corrected")),
        task,
        train.window(POINTS),
        [(validation, range(1, POINTS))],
        description["seeds"],
        settings,
        "ours",
    )
    seconds, steps, reached = 0.0, epochs * train.steps(100), math.inf
    best = torch.full((seeds,), math.inf)
    for epoch in range(epochs):
        start = time.process_time()
        for number, batch in enumerate(trainer.sets(epoch).batches(trainer.seeds, epoch, 100)):
            trainer.step(batch, settings.rate(epoch * train.steps(100) + number, steps))
        trainer.objective.end_of_pass()
        seconds += time.process_time() - start
        best = torch.minimum(best, trainer.score())
        if best.mean() <= target:
            reached = min(reached, seconds)
            break
    return reached, float(best.mean())


def main() -> None:
    """Print both and their ratio."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--baseline-seeds", type=int, default=1)
    parser.add_argument("--baseline-steps", type=int, default=2500)
    parser.add_argument("--epochs", type=int, default=60, help="passes of ours, 10 steps each")
    options = parser.parse_args()
    torch.set_num_threads(1)
    train, validation = training_data(), training_data(100, "validation")
    runs = [baseline(seed, train, validation, options.baseline_steps) for seed in range(options.baseline_seeds)]
    seconds = sum(r[0] for r in runs) / len(runs) * options.seeds
    target = sum(r[1] for r in runs) / len(runs)
    print(
        f"usual way: {seconds:.0f} CPU s for {options.seeds} seeds ({len(runs)} measured), score {target:.2f}",
        flush=True,
    )
    reached, score = ours(options.seeds, train, validation, options.epochs, target)
    print(
        f"stacked, one-cycle: {reached:.0f} CPU s to that score (then {score:.2f}), "
        f"{seconds / reached:.1f} times sooner"
    )


if __name__ == "__main__":
    main()
