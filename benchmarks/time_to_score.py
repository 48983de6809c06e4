"""How long ten seeds take to a given validation score: ``python benchmarks/time_to_score.py`` (ten minutes).

The baseline is the usual way of benchmarks/training_step.py with the paper's networks, its constant learning rate of
5e-4 and its 2,500 steps.  It runs seed after seed, so ``--baseline-seeds`` of them are measured and their time is
scaled to ten (the score is their mean).  Ours is what config/config.yaml says of the pendulum, in ``--epochs`` passes,
for ten stacked seeds; it is timed until the mean of its seeds' best validation scores passes the baseline's final one.
The score of both is the log mean squared error of the forecast over [t0, t1] on the validation set; the time spent on
computing scores counts for neither.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import torch

from expertaug import systems
from expertaug.config.load import load, validate
from expertaug.learning.objectives import Aphynity
from expertaug.learning.trainer import Trainer, TrainSettings
from expertaug.learning.training_data import StackedSet, task_of
from expertaug.models.card import ModelCard
from expertaug.models.estimators import Hybrid
from training_step import POINTS, STEP, UsualModel, training_data


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
    config = validate(load([Path(__file__).parents[1] / "config" / "config.yaml"])).experiments["pendulum"]
    card = ModelCard.of(
        kind="hybrid",
        system={"name": "pendulum"},
        model=config.model.dump(),
        t=[k * STEP for k in range(201)],
        observed=POINTS,
        seeds=list(range(seeds)),
    )
    stacked = Hybrid.network(systems.load({"name": "pendulum"}), card)
    stacked.fit(train.windows(POINTS).seed(0))
    settings = TrainSettings.from_mapping(config.training.dump() | {"epochs": epochs})
    trainer = Trainer(
        stacked,
        Aphynity(card.seeds, config.choices, **(config.training.objective or {})),
        task_of(settings, card, torch.device("cpu")),
        train.window(POINTS),
        [(validation, range(1, POINTS))],
        card.seeds,
        settings,
        "ours",
    )
    seconds, steps, reached = 0.0, epochs * train.steps(settings.batch_size), math.inf
    best = torch.full((seeds,), math.inf)
    for epoch in range(epochs):
        start = time.process_time()
        for number, batch in enumerate(trainer.sets(epoch).batches(trainer.seeds, epoch, settings.batch_size)):
            trainer.step(batch, epoch * train.steps(settings.batch_size) + number, steps)
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
    parser.add_argument("--epochs", type=int, default=70, help="passes of ours, 10 steps each")
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
