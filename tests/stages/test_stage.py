"""A stage reads its settings before it runs, and knows the files that it is made of."""

from __future__ import annotations

import argparse
import json

import pytest

from expertaug import source_files
from expertaug.equation.settings import EquationSettings
from expertaug.errors import InputErrors, lines
from expertaug.stages import STAGES
from expertaug.stages.planned import STUDIES
from expertaug.stages.stage import Stage, StageWithPrior, to_json


class Sweep(Stage):
    """sweep the
    floor"""

    name = "sweep-floor"
    code = "expertaug.wording"
    job = "expertaug.equation.settings:EquationSettings"
    given: list = []  # noqa: RUF012

    @staticmethod
    def run(a, job):
        Sweep.given.append(job)


class Draw(StageWithPrior):
    """draw"""

    name = "draw"
    job = "expertaug.inference.settings:OwnPriorJob"


def test_it_is_called_after_its_name_and_its_docstring():
    assert (Sweep.key(), Sweep.text(), Sweep.products()) == ("sweep_floor", "sweep the floor", ())


def test_settings_are_checked_before_it_runs():
    Sweep.given.clear()
    with pytest.raises(InputErrors) as caught:
        Sweep.execute(argparse.Namespace(settings='{"sample": 3, "most_terms": 0}'))
    assert [line.partition(";")[0] for line in lines(caught.value)] == [
        "--settings.sample: unknown key",
        "--settings.most_terms: found 0",
    ]
    assert Sweep.given == []
    Sweep.execute(argparse.Namespace(settings='{"samples": 3}'))
    assert Sweep.given == [EquationSettings(samples=3)]


def test_a_job_is_the_same_text_however_its_keys_are_ordered():
    assert to_json({"b": 1, "a": {"d": 2, "c": None}}) == to_json({"a": {"c": None, "d": 2}, "b": 1})
    assert json.loads(to_json(EquationSettings(samples=3))) == {"samples": 3}, "what was not given is not written"


def test_found_ranges_complete_the_settings_of_a_stage_that_needs_them(tmp_path):
    (tmp_path / "prior.json").write_text('{"ranges": {"k": [1, 2]}}')
    given = argparse.Namespace(prior=tmp_path / "prior.json")
    assert Draw.complete(given, {"prior": "own"}) == {"prior": {"k": [1.0, 2.0]}}
    assert Sweep.complete(given, {"prior": "own"}) == {"prior": "own"}


def test_its_software_changes_with_a_file_that_it_is_made_of(tmp_path, monkeypatch):
    assert [path.name for path in Sweep.sources()] == ["__init__.py", "errors.py", "wording.py"]
    (tmp_path / "own_broom.py").write_text("import numpy\n")
    monkeypatch.syspath_prepend(tmp_path)
    digest, *packages = Sweep.software(["own_broom:Broom"])
    assert digest != Sweep.software()[0] and digest == source_files.digest([Sweep.code, "own_broom"])
    assert Sweep.software()[1:] == [] and [text.split()[0] for text in packages] == ["numpy"]


class Fold(Stage):
    """fold"""

    name = "fold-sheets"

    @staticmethod
    def add_arguments(parser):
        parser.add_argument("sheets", nargs="+")
        parser.add_argument("--output", required=True)
        parser.add_argument("--on-edge", choices=("stop", "go"), default="stop")
        parser.add_argument("--colour")
        parser.add_argument("--pages", nargs="*", default=[])


def test_a_rules_shell_has_each_value_at_its_option():
    places = "input.files output.sheet params.colour params.pages resources.on_edge"
    assert Fold.command(places) == (
        "expertaug fold-sheets {input.files:q} --output {output.sheet:q} {params.colour} --pages {params.pages:q}"
        " --on-edge {resources.on_edge:q} --log {log:q}"
    )
    assert Fold.command("params.sheets params.folder", "{params.stage}") == (
        "expertaug {params.stage} {params.sheets:q} --output {params.folder:q} --log {log:q}"
    )
    for places, problem in {
        "input.sheets": "needs output, sheets",
        "output": "needs sheets, has output",
        "input.sheets output params.width": r"takes no params\.width",
    }.items():
        with pytest.raises(TypeError, match=problem):
            Fold.command(places)


@pytest.mark.parametrize("stages", [("train", "alternate", "share"), ("cut_horizon", "cut_measured_horizon")])
def test_stages_between_which_a_rules_jobs_choose_take_the_same(stages):
    places = "input.files output" if "cut_horizon" in stages else "params.data output params.work params.prior"
    assert len({STAGES[stage].command(places, "{params.stage}") for stage in stages}) == 1


@pytest.mark.parametrize("runs_models", [False, True])
def test_studies_of_a_kind_take_the_same(runs_models):
    places = "input.models params.data output" if runs_models else "input.files output"
    of_kind = [stage for stage in STUDIES.values() if stage.runs_models == runs_models]
    assert len({stage.command(places, "{params.stage}") for stage in of_kind}) == 1
