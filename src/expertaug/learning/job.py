"""A training as a job of the workflow: locked, resumed after a kill, logged, its best state written as a model file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from expertaug.learning import snapshots
from expertaug.learning.checkpoint import Checkpoint, fingerprint, locked
from expertaug.learning.fitting import Training
from expertaug.learning.settings import named_modules
from expertaug.models import store
from expertaug.settings import Settings
from expertaug.tracking.log import Run
from expertaug.tracking.run_log import RunLog
from expertaug.tracking.settings import Tracking


def run(
    training: Training,
    output: Path,
    work: Path,
    inputs: Sequence[Path],
    settings: Settings,
    tracking: Tracking | None,
    module: str | None = None,
) -> None:
    """Run a training, resuming a killed run of it, and write the model file.

    Where the training keeps states of its passes they are written beside it.

    Arguments:
        output: model file; log.jsonl lies beside it.
        work: folder for checkpoints.
        inputs: files that the training depends on: a checkpoint of others is not used.
        settings: of the stage; a checkpoint of others is not used.
        tracking: see :class:`RunLog`.
        module: of the stage, whose files a checkpoint stands for; None: the module of learning with the stage's name.
    """
    output, work, trainer, card = Path(output), Path(work), training.trainer, training.card
    with locked(work):
        said = settings.to_json()
        wanted = {k: v for k, v in said.items() if k != "device"}
        named = named_modules(card.system_name, card.model.to_json(), card.objective)
        code = [module or f"expertaug.learning.{card.stage}", *named]
        checkpoint = Checkpoint(work, fingerprint(wanted, list(inputs), code))
        state = checkpoint.load()
        if state is not None:
            trainer.restore(state)
        run = Run(
            experiment=card.experiment,
            method=card.method,
            label=card.label,
            preset=card.preset,
            stage=card.stage,
            system=card.system_name,
            seeds=tuple(trainer.seeds),
            params={k: v for k, v in said.items() if k not in ("seeds", "label")},
            tags={"fingerprint": checkpoint.fingerprint},
        )
        resume = state["log"] if state is not None else None
        with RunLog(output.with_name("log.jsonl"), run, tracking, resume) as log:
            if not log.continued:
                for path in inputs:
                    log.dataset(path.stem, path)
            stored = training.run(log, checkpoint)
            if trainer.keep:
                snapshots.save(output.with_name(snapshots.NAME), trainer.snapshots, card.but(failed=stored.failed))
            store.save(output, stored.model, stored.card)
            log.artifact(output)
        checkpoint.remove()
