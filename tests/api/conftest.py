"""What the tests of the front door share: a tiny pendulum, trained once."""

import pytest
from small_pendulum import ENCODER, FRICTION, INTERACTION, OPTIONS, SEEN, SHIFTED, T

import expertaug as ea


@pytest.fixture(scope="session")
def sets():
    sizes = {"train": 40, "validation": 10, "test": 10}
    return {
        name: ea.simulate(ea.DampedPendulum(), SEEN, FRICTION, n=n, t=T, noise=0.01, seed=0, name=name)
        for name, n in sizes.items()
    }


@pytest.fixture(scope="session")
def recipe():
    return ea.HybridModel(ea.DampedPendulum(), encoder=ENCODER, interaction=INTERACTION)


@pytest.fixture(scope="session")
def fit(sets, recipe):
    return ea.fit(recipe, sets["train"], sets["validation"], observed_s=1.0, seeds=[0, 1], **OPTIONS)


@pytest.fixture(scope="session")
def plus(sets, fit):
    return ea.finetune(fit, sets["train"], sets["validation"], prior=SHIFTED, noise=0.01, **OPTIONS)
