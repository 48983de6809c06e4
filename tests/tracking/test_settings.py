"""Which store mirrors the logs, where its pages are, and what a results folder says of it."""

from __future__ import annotations

import json
import shlex
from urllib.parse import parse_qs

import pytest

from expertaug.tracking.settings import MARKER, Tracking, tracking_of_run

STORE = {"enabled": True, "uri": "sqlite:///my results/mlflow.db", "experiment": "trial", "experiments": {"swing": "3"}}


def test_a_local_store_is_served_by_a_command_and_a_server_by_itself():
    local, server = Tracking(**STORE), Tracking(**STORE | {"uri": "https://host/mlflow/"})
    assert shlex.split(local.command) == ["mlflow", "server", "--backend-store-uri", STORE["uri"]]
    assert server.command is None and server.address == "https://host/mlflow"
    assert local.name_of("swing") == "trial swing"


def test_the_page_of_an_experiment_searches_for_a_condition():
    condition = "tags.label = 'Hybrid+ & co'"
    page = Tracking(**STORE).page_of("swing", condition)
    place, _, query = page.partition("?")
    assert place == "http://127.0.0.1:5000/#/experiments/3/runs"
    assert parse_qs(query)["searchFilter"] == [condition]
    assert Tracking(**STORE).page_of("slide") is None
    assert Tracking(**STORE | {"experiments": None}).page_of("swing") is None


@pytest.mark.parametrize("text", ['{"enabled": false}', "[1]", "{", '{"enabled": true}'])
def test_a_results_folder_without_a_store_that_can_be_used_has_none(tmp_path, text):
    assert tracking_of_run(tmp_path) is None
    (tmp_path / MARKER).parent.mkdir()
    (tmp_path / MARKER).write_text(text)
    assert tracking_of_run(tmp_path) is None


def test_a_results_folder_says_which_store_it_has_unless_a_link_says_it(tmp_path):
    elsewhere, results = tmp_path / "elsewhere.json", tmp_path / "results"
    elsewhere.write_text(json.dumps(STORE))
    (results / MARKER).parent.mkdir(parents=True)
    (results / MARKER).symlink_to(elsewhere)
    assert tracking_of_run(results) is None
    (results / MARKER).unlink()
    (results / MARKER).write_text(json.dumps(STORE))
    assert tracking_of_run(results) == Tracking(**STORE)
