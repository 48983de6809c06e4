"""What is made of snapshots of a training: themselves, and fine-tunings of several lengths."""

from __future__ import annotations

from expertaug.learning.during_training import BASE, ModelState, Steps, states
from expertaug.learning.settings import AugmentJob, FinetuneJob, TrainSettings
from tiny import PRIOR, of_kind


class Told(Steps):
    """Steps that do nothing but tell what they were asked for."""

    def __init__(self):
        self.asked = []

    def augment(self, base, drawing):
        self.asked.append((base.epoch, drawing.noise))
        return f"samples of {base.stored}"

    def finetune(self, base, plus, options, progress=None):
        self.asked.append((base.epoch, plus, options.training.epochs))
        return f"{base.stored} after {options.training.epochs}"


def test_each_snapshot_is_followed_by_fine_tunings_of_each_length_on_the_same_augmented_samples(settings):
    drawing = of_kind(AugmentJob, settings, method="aphynity+", prior=PRIOR, noise=0.01)
    training = TrainSettings(epochs=9, batch_size=20)
    tuning = of_kind(FinetuneJob, settings, method="aphynity+", label="APHYNITY+", training=training)
    steps, trained = Told(), [ModelState(1, BASE, "early"), ModelState(3, BASE, "late")]
    found = list(states(trained, steps, drawing, tuning, [1, 5]))
    assert [(state.epoch, state.finetune_epochs) for state in found] == [(1, 0), (1, 1), (1, 5), (3, 0), (3, 1), (3, 5)]
    assert [state.stored for state in found[3:]] == ["late", "late after 1", "late after 5"]
    assert steps.asked[:3] == [(1, 0.01), (1, "samples of early", 1), (1, "samples of early", 5)]
    assert len(steps.asked) == 6 and tuning.training.epochs == 9, "each schedule is its own"
