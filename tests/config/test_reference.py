"""The reference of the configuration, and the schema beside it, are what the models say."""

from __future__ import annotations

import json
import re
from pathlib import Path

from expertaug.config import reference, schema

ROOT = Path(__file__).parents[2]


def test_what_is_made_from_the_models_is_as_they_are():
    text = (ROOT / "config" / "README.md").read_text(encoding="utf-8")
    assert text.partition(reference.BEGIN)[2].strip() == reference.reference().strip(), "see the README's marker"
    found = json.loads((ROOT / "config" / "schema.json").read_text(encoding="utf-8"))
    assert found == schema.schema(), "python -m expertaug.config.schema config/schema.json"


def test_a_key_is_a_row_with_its_type_limits_unit_default_and_meaning():
    text = reference.reference()
    assert "| `t1_s` | number > 0 in s | – | end of the observed window |" in text
    assert "| `worst` | number ≥ 0, ≤ 1 | `0.0` | " in text
    assert "| `device` | `auto`, `cpu`, `cuda` | `'auto'` | where to train and evaluate" in text
    titles = re.findall(r"^## (.+)$", text, re.M)
    assert titles[0] == "Top level" and len(titles) == len(set(titles))
