"""Settings of inference: what follows from them, and what is refused in one line."""

from __future__ import annotations

import pytest

from expertaug.errors import InputError
from expertaug.inference.settings import AlternatingSettings, FlowSettings, OwnPriorJob


def test_a_pool_is_a_whole_number_of_renewals_and_a_pass_goes_once_over_it():
    settings = FlowSettings(steps=1000, batch_size=33, pool=100, uses=3)
    assert (settings.renewed, settings.size) == (33, 99)
    training = settings.training
    assert training.epochs == round(1000 * 33 / 99) and training.validate_every == training.epochs // 25
    assert (training.batch_size, training.learning_rate) == (33, settings.learning_rate)
    assert FlowSettings(steps=1, batch_size=1, pool=100).training.epochs == 1, "a pass at least"


@pytest.mark.parametrize(
    ("kind", "given", "says"),
    [
        (FlowSettings, {"bins": 1}, r"flow\.bins: found 1"),
        (FlowSettings, {"jitter": 2.0}, r"flow\.jitter: found 2"),
        (FlowSettings, {"step": 3}, r"flow\.step: unknown key; did you mean 'steps'"),
        (AlternatingSettings, {"latent": -1}, r"alternation\.latent: found -1"),
        (OwnPriorJob, {"windows": [], "budget": 1.0, "noise": 0.1, "refinement": {}}, "budget: found 1"),
    ],
)
def test_what_cannot_be_is_refused_in_a_line(kind, given, says):
    with pytest.raises(InputError, match=says) as caught:
        kind.of(**given)
    assert "\n" not in str(caught.value)
