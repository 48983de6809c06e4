"""The stages of the pipeline, one class each: read, call, write.

The subcommands of ``expertaug``, what the workflow passes to each and when it redoes it follow from these classes: a
new stage is a class in the module of its subject and a rule.
"""

from __future__ import annotations

from expertaug.stages import evaluation, learning, measurements, recordings, tracking
from expertaug.stages.stage import Stage

SUBJECTS = (recordings, measurements, learning, evaluation, tracking)
# By the name that rules, logs and targets have for it.
STAGES: dict[str, type[Stage]] = {
    kind.key(): kind
    for subject in SUBJECTS
    for kind in vars(subject).values()
    if isinstance(kind, type) and issubclass(kind, Stage) and "name" in vars(kind)
}
