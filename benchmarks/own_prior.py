"""What a p⁺ that finds its own ranges is worth on the pendulum: one seed, short; the test range is never given.

python benchmarks/own_prior.py
"""

from __future__ import annotations

from functools import partial

import expertaug as ea

PENDULUM, FRICTION, T, NOISE = ea.DampedPendulum(), {"alpha": (0.0, 0.6)}, [0.1 * k for k in range(101)], 0.01
SEEN, SHIFTED = {"omega0": (1.5, 3.1)}, {"omega0": (0.5, 1.5)}
HOW = {"epochs": 80, "learning_rate": 3e-3}
GIVEN = {"narrow": (1.0, 3.3), "matched": (0.5, 3.5), "wide": (0.1, 7.0)}


def main() -> None:
    train, validation, iid = (
        ea.simulate(PENDULUM, SEEN, FRICTION, n=n, t=T, seed=seed, noise=NOISE)
        for n, seed in ((400, 0), (60, 1), (100, 7))
    )
    test = ea.simulate(PENDULUM, SHIFTED, FRICTION, n=200, t=T, seed=2, noise=NOISE)
    windows = {"theta": (0, 5), "omega": (0, 5)}
    encoder = partial(ea.WindowEncoder, windows=windows, layers=(100, 100), latent=1)
    model = ea.HybridModel(PENDULUM, encoder, interaction=partial(ea.DampingInteraction, components=["omega"]))
    objective = partial(ea.Aphynity, lambda0=100)
    fit = ea.fit(model, train, validation, observed_s=5.0, objective=objective, horizon_warmup=0.3, **HOW)
    fits = {"noise": NOISE, "prior": {"omega0": (1.0, 4.0)}, "starts": 16, "tries": 2, "steps": 12}
    own = ea.own_prior(fit, train, test.y[:, :51], **fits)
    budget = ea.own_prior(fit, train, **fits)
    print(own.says, budget.says, sep="\n")
    priors = {name: {"omega0": ends} for name, ends in GIVEN.items()} | {"own": own.ranges, "budget": budget.ranges}
    draws = {name: ea.augment(fit, train, validation, prior=prior, noise=NOISE) for name, prior in priors.items()}
    draws["matched, worst 0.5"] = ea.augment(fit, train, validation, prior=priors["matched"], noise=NOISE, worst=0.5)
    told = {"supervision_weight": 30.0, "choices": {"resample": "epoch"}, **HOW}
    tuned = {name: ea.finetune(fit, train, validation, augmented=one, **told) for name, one in draws.items()}
    for name, one in {"not augmented": fit, **tuned}.items():
        found = [one.evaluate(data).set_index("metric")["value"] for data in (iid, test)]
        scores = [f"{f['log_mse_sum']:6.2f} {f['relative_error']:6.1f} %" for f in found]
        print(f"{name:20} IID {scores[0]}   test {scores[1]}")


if __name__ == "__main__":
    main()
