"""What a flow's draws cost by how many are made at a time: processor time and peak memory, a process each.

python benchmarks/flow_draws.py [--windows 300] [--draws 256]

The chunk that the package has is ``expertaug.inference.flow.CHUNK``.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import time
from functools import partial

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before torch

import expertaug as ea

EXPONENTS = (9, 11, 13, 15, 17)


def measured(exponent: int, windows: int, draws: int) -> tuple[float, float]:
    """Seconds of processor time, and by how many MiB drawing raised the peak of memory."""
    from expertaug.inference import flow

    t = [0.1 * k for k in range(101)]
    pendulum, friction = ea.DampedPendulum(), {"alpha": (0.0, 0.6)}
    train = ea.simulate(pendulum, {"omega0": (1.5, 3.1)}, friction, n=max(windows, 100), t=t, seed=0, noise=0.01)
    encoder = partial(ea.WindowEncoder, windows={"theta": (0, 5), "omega": (0, 5)}, layers=(100, 100), latent=1)
    model = ea.HybridModel(pendulum, encoder, interaction=partial(ea.DampingInteraction, components=["omega"]))
    fit = ea.fit(model, train, train, observed_s=5.0, objective=partial(ea.Aphynity, lambda0=100), epochs=1)
    prior = {"omega0": (0.3, 3.5)}
    posterior = ea.fit_posterior(fit, train, prior=prior, noise=0.01, steps=2, pool=64, held_out=32, samples=draws)
    flow.CHUNK = 2**exponent
    observed, before, start = train.y[:windows, :51], peak(), time.process_time()
    posterior.estimate(observed, t[:51])
    return time.process_time() - start, peak() - before


def peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--windows", type=int, default=300)
    parser.add_argument("--draws", type=int, default=256, help="of each window")
    options = parser.parse_args()
    for exponent in EXPONENTS:
        with multiprocessing.get_context("spawn").Pool(1) as pool:  # the peak of memory is a process's own
            seconds, memory = pool.apply(measured, (exponent, options.windows, options.draws))
        print(f"2^{exponent:<2} draws at a time: {seconds:6.2f} CPU-s, {memory:6.0f} MiB more", flush=True)


if __name__ == "__main__":
    main()
