"""The study of where F_a holds."""

from __future__ import annotations

import pytest
from fitted_pendulum import NOISE, PRIOR, pendulum
from rubbing_term import Friction, stored

from expertaug.errors import InputError
from expertaug.evaluation import validity
from expertaug.evaluation.settings import FittedVersion, ValidityJob
from expertaug.inference.settings import ValiditySettings
from expertaug.models.decoder import Decoder
from expertaug.models.fit_settings import Refinement, RefinementSettings
from expertaug.systems.pendulum import DampedPendulum


@pytest.mark.slow
def test_the_study_has_a_sentence_a_version():
    sets = {}
    for name, z_e in (("train", (1.5, 3.1)), ("validation", (1.5, 3.1)), ("test", (0.6, 1.5))):
        sets[name] = pendulum(z_e, damping=(0.2, 0.5), n=12)
    model = stored(Decoder(DampedPendulum(), Friction()), pendulum((1.5, 3.1), n=3))
    fit = Refinement(settings=RefinementSettings(starts=8, tries=1, steps=10), noise=NOISE, prior=PRIOR)
    job = ValidityJob(
        experiment="pendulum",
        versions=[FittedVersion("aphynity", "APHYNITY", fit)],
        hues=[("aphynity", 0)],
        validity=ValiditySettings(samples=10, steps=2),
        device="cpu",
    )
    study = validity.validity([model], sets, job)
    table = study.numbers.set_index("set")
    assert list(table.index) == ["train", "validation", "test"] and table.loc["test", "windows"] == 10
    assert table.loc["test", "wrong"] < 30 and table.loc["test", "explained"] > 50
    text = study.markdown()
    assert "- APHYNITY: F_a learned on omega0 in [1." in text and "holds in" in text
    assert len(study.figure().axes) == 2 and "holds in" not in study.tex()


def test_a_version_of_which_nothing_says_how_its_windows_are_fitted_is_refused():
    data = pendulum((1.5, 3.1), damping=(0.2, 0.5), n=2)
    versions = [FittedVersion("aphynity", "APHYNITY", None)]
    job = ValidityJob(experiment="pendulum", versions=versions, validity=ValiditySettings(), device="cpu")
    with pytest.raises(InputError, match="nothing says how its windows are fitted; give settings, noise and prior"):
        validity.validity([stored(Decoder(DampedPendulum(), Friction()), data)], {"train": data}, job)
