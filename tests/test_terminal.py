"""What the terminal says of a run: a line when a job starts and one when it fails, and no list of files."""

from __future__ import annotations

import io
import logging
from types import SimpleNamespace

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

import snakemake_logger_plugin_expertaug as plugin

FILES = [f"results/file_{k}.csv" for k in range(300)]


def record(message=None, event=None, **fields):
    made = logging.makeLogRecord({"msg": message, "levelno": logging.INFO, "levelname": "INFO"} | fields)
    if event is not None:
        made.event = event
    return made


@pytest.fixture
def said(monkeypatch):
    """What a handler with these settings writes of records."""

    def write(*records, **settings):
        given = {
            "dryrun": False,
            "printshellcmds": False,
            "verbose": False,
            "stdout": False,
            "nocolor": True,
        } | settings
        handler = object.__new__(plugin.LogHandler)
        logging.Handler.__init__(handler)
        handler.common_settings = SimpleNamespace(**given)
        handler.__post_init__()
        handler.terminal.stream = io.StringIO()
        for one in records:
            handler.emit(one)
        return handler.terminal.stream.getvalue()

    return write


def job(message):
    fields = {"rule_name": "everything", "rule_msg": message, "jobid": 3, "input": FILES, "output": FILES, "log": []}
    return record(None, LogEvent.JOB_INFO, **fields)


def test_a_job_is_a_line(said):
    text = said(
        job("train aphynity"), record("Execute 1 jobs...", LogEvent.JOB_STARTED), record("x", LogEvent.JOB_FINISHED)
    )
    assert text.strip().endswith("train aphynity") and len(text.strip().splitlines()) == 1


def test_a_target_is_none(said):
    assert said(job(None)) == ""


def test_a_failed_job_says_which_and_where_its_log_lies(said):
    fields = {"rule_name": "train", "rule_msg": "train aphynity", "jobid": 3, "log": ["results/logs/train.log"]}
    text = said(record(None, LogEvent.JOB_ERROR, **fields, input=FILES, output=FILES, shellcmd="expertaug train"))
    assert "Error in rule train: train aphynity (log: results/logs/train.log)" in text and "file_1" not in text


SETUP = ["Building DAG of jobs...", "Provided cores: 2", "Select jobs to execute...", "Touching output file a.csv."]


@pytest.mark.parametrize("line", SETUP)
def test_how_it_is_set_up_is_not_said(line, said):
    assert said(record(line)) == ""


@pytest.mark.parametrize("line", ["Nothing to be done", "Report: results/report.html", "a warning"])
def test_the_rest_is(line, said):
    assert said(record(line)).strip() == line


@pytest.mark.parametrize("setting", ["dryrun", "printshellcmds", "verbose"])
def test_who_asks_for_more_gets_all(setting, said):
    assert "Building DAG" in said(record("Building DAG of jobs..."), **{setting: True})
