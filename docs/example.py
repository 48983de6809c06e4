"""A pendulum with a friction that the expert does not know, forecast where it is slower than any seen in training."""

from functools import partial

import expertaug as ea

pendulum, friction, t = ea.DampedPendulum(), {"alpha": (0.0, 0.6)}, [0.1 * k for k in range(101)]
train, val = (ea.simulate(pendulum, {"omega0": (1.5, 3.1)}, friction, n=n, t=t, seed=s) for n, s in ((300, 0), (50, 1)))
test = ea.simulate(pendulum, {"omega0": (0.5, 1.5)}, friction, n=50, t=t, seed=2)
encoder = partial(ea.WindowEncoder, windows={"theta": (0, 3), "omega": (0, 3)}, layers=(100, 100), latent=1)
model = ea.HybridModel(pendulum, encoder, interaction=partial(ea.DampingInteraction, components=["omega"]))
how = {"epochs": 40, "learning_rate": 3e-3}
fit = ea.fit(model, train, val, observed_s=3.0, objective=partial(ea.Aphynity, lambda0=100), seeds=range(2), **how)
plus = ea.finetune(fit, train, val, prior={"omega0": (0.3, 3.5)}, supervision_weight=30.0, **how)
print(ea.evaluate({"APHYNITY": fit, "APHYNITY+": plus}, test).pivot_table("value", "metric", "label").round(2))
out = plus[0].forecast(test.y[:, :31], t)  # out.y: states (50, 101, 2); out.z_e["omega0"]: estimates (50,) in rad/s
