"""Subcommands about the tracking store and finished runs: which store, and which run is not finished."""

from __future__ import annotations

from pathlib import Path

import pytest

from expertaug.commands import housekeeping
from expertaug.errors import InputError
from subcommands import call


@pytest.mark.parametrize(
    ("words", "uri", "experiment"),
    [
        ([], "sqlite:///results/mine/mlflow/mlflow.db", "expertaug"),
        (["--uri", "http://host", "--experiment", "e"], "http://host", "e"),
    ],
)
def test_the_store_that_is_rebuilt_is_that_of_the_results_folder_unless_another_is_named(
    monkeypatch, words, uri, experiment
):
    given = []
    monkeypatch.setattr("expertaug.tracking.rebuild.rebuild", lambda *a: given.append(a) or 3)
    call(housekeeping, "rebuild-tracking", "results/mine", *words)
    assert given == [(Path("results/mine"), uri, experiment)]


def test_a_run_that_lacks_a_table_is_not_published(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("my.yaml").write_text("{run: [pendulum], results: out}")
    with pytest.raises(InputError, match=r"^out/.*: no such file \(and \d+ others\); run the workflow"):
        call(housekeeping, "publish", "my.yaml", "--to", "kept", "--command", "snakemake")
    assert not Path("kept").exists()
