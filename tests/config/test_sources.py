"""The user's files that a configuration names: how they are found, and that they lie outside of the results folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from expertaug.config import load as config
from expertaug.config import sources
from expertaug.config.models import Configuration, Data, Experiment
from expertaug.config.sources import refuse_within_results
from expertaug.errors import InputError
from expertaug_recordings.settings import RecordingKeys


def told(results, source="videos", path="videos", checksums=None):
    own = {} if source == "rendered" else {source: {"path": path}}
    recordings = RecordingKeys.of(source=source, checksums=checksums, **own)
    return Configuration.model_construct(results=str(results), recordings=recordings)


@pytest.fixture
def results(tmp_path):
    (tmp_path / "results" / "mine").mkdir(parents=True)
    (tmp_path / "results" / "mine" / "a.mp4").touch()
    return tmp_path / "results"


def test_recordings_elsewhere_are_taken(results, tmp_path):
    (tmp_path / "a.mp4").touch()
    refuse_within_results(told(results), {"a": str(tmp_path / "a.mp4")})
    refuse_within_results(told(results, "rendered"), {"rendered_00": 0})
    refuse_within_results(told(results, path=str(results / "mine")), {})  # no experiment of the run takes recordings


def test_recordings_in_the_results_folder_are_refused_in_one_line(results, tmp_path, monkeypatch):
    with pytest.raises(
        InputError, match=r"^recordings\.videos\.path: '.*a\.mp4' lies in the results folder .*; move it"
    ):
        refuse_within_results(told(results), {"a": str(results / "mine" / "a.mp4")})
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="results folder 'results'"):
        refuse_within_results(told("results"), {"a": "results/mine/../mine/a.mp4"})


def test_a_link_hides_nothing(results, tmp_path):
    (tmp_path / "link.mp4").symlink_to(results / "mine" / "a.mp4")
    (results / "out.mp4").symlink_to(tmp_path / "b.mp4")
    for path in (tmp_path / "link.mp4", results / "out.mp4"):
        with pytest.raises(InputError, match="results folder"):
            refuse_within_results(told(results), {"a": str(path)})


def test_an_archive_and_checksums_in_the_results_folder_are_refused(results):
    with pytest.raises(InputError, match=r"^recordings\.markers\.path: "):
        refuse_within_results(told(results, "markers", str(results / "markers.tar.gz")), None)
    with pytest.raises(InputError, match=r"^recordings\.checksums: "):
        refuse_within_results(told(results, "rendered", checksums=str(results / "SHA256SUMS")), {"rendered_00": 0})


def test_videos_of_one_name_are_refused(tmp_path):
    for name in ("a.mp4", "b.mkv", "notes.txt"):
        (tmp_path / name).touch()
    assert list(sources.list_videos(str(tmp_path))) == ["a", "b"]
    assert list(sources.list_videos(str(tmp_path / "*.mkv"))) == ["b"]
    (tmp_path / "A.avi").touch()
    with pytest.raises(InputError, match="two files of one name"):
        sources.list_videos(str(tmp_path))


def test_recordings_are_listed_by_name(base: dict, tmp_path: Path) -> None:
    for name in ("10.csv", "2.csv", "a.mp4"):
        (tmp_path / name).touch()
    found = {}
    for source in ("rendered", "videos", "markers"):
        over = {"recordings": {"source": source, source: {"path": str(tmp_path)} if source != "rendered" else {}}}
        found[source] = sources.list_recordings(config.validate(config.merge(base, over)))
    assert list(found["rendered"].values()) == list(range(6))
    assert found["videos"] == {"a": str(tmp_path / "a.mp4")}
    assert found["markers"] == {"2": str(tmp_path / "2.csv"), "10": str(tmp_path / "10.csv")}
    simulated = config.validate(config.merge(base, {"run": ["pendulum"]}))
    assert sources.list_recordings(simulated) == {}


def test_measurements_are_listed_by_experiment_and_names_that_the_workflow_takes_otherwise_are_refused(tmp_path):
    data = Data.of(source="files", t1_s=1.0, files={"paths": str(tmp_path / "*.csv"), "columns": {"x": "x"}})
    found = Configuration.model_construct(
        run=["lab"], experiments={"lab": Experiment.model_construct(data=data), "other": None}
    )
    for name in ("b.csv", "a.csv"):
        (tmp_path / name).write_text("t,x\n0,1\n")
    assert sources.list_measurements(found) == {"lab": [str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]}
    (tmp_path / "c{d}.csv").write_text("t,x\n0,1\n")
    with pytest.raises(InputError, match=r"experiments\.lab\.data\.files\.paths: .* has braces"):
        sources.list_measurements(found)
