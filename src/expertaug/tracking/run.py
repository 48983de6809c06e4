"""What a run log is about: the job that runs, as its header says."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Run:
    """A job that logs.

    Attributes:
        experiment, method, label, system, preset, stage: what runs.
        seeds: the seeds that are trained together, in the order of every metric's values; empty: one run without any.
        params: the settings, in any nesting that JSON holds.
        tags: further texts for the store.
    """

    experiment: str
    method: str
    label: str
    system: str
    preset: str
    stage: str
    seeds: Sequence[int]
    params: Mapping[str, Any]
    tags: Mapping[str, str] = field(default_factory=dict)

    def header(self, identity: str) -> dict[str, Any]:
        """The first line of the log ``identity``, begun now."""
        return {
            "id": identity,
            "time": time.time(),
            "experiment": self.experiment,
            "method": self.method,
            "label": self.label,
            "system": self.system,
            "preset": self.preset,
            "stage": self.stage,
            "seeds": [int(seed) for seed in self.seeds],
            "params": json.loads(json.dumps(self.params, default=str), parse_constant=str),
            "tags": {key: str(value) for key, value in self.tags.items()},
        }
