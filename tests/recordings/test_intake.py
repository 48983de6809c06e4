import json

import pytest

from expertaug import cli
from expertaug.errors import InputError
from expertaug.files import sha256, write_json, write_text
from expertaug_recordings.intake import divide, refusal, take


def refuse(where):
    def task():
        raise InputError(where, "is spoiled", "copy it again")

    return task


@pytest.fixture
def source(tmp_path):
    (tmp_path / "video.mp4").write_text("data")
    return tmp_path / "video.mp4"


def test_a_refused_recording_stops_or_leaves_its_reason_in_every_output(source, tmp_path):
    outputs = [tmp_path / "a" / "angles.csv", tmp_path / "a" / "angles.json"]
    with pytest.raises(InputError, match="is spoiled"):
        take(refuse(source), source, outputs, "stop")
    assert not any(path.exists() for path in outputs)
    take(refuse(source), source, outputs, "skip")
    assert [refusal(path) for path in outputs] == [f"{source}: is spoiled; copy it again"] * 2


def test_the_next_stage_passes_the_reason_on_without_running(source, tmp_path):
    take(refuse(source), source, [tmp_path / "frames"], "skip")
    take(pytest.fail, tmp_path / "frames", [tmp_path / "markers.csv"], "skip")
    assert refusal(tmp_path / "markers.csv") == f"{source}: is spoiled; copy it again"
    with pytest.raises(InputError, match=r"left out before .*is spoiled"):
        take(pytest.fail, tmp_path / "frames", [tmp_path / "other.csv"], "stop")


def test_what_is_not_the_recording_s_fault_stops_the_run_even_so(source, tmp_path):
    with pytest.raises(InputError, match=r"recordings\.tracking"):
        take(refuse("recordings.tracking"), source, [tmp_path / "out"], "skip")
    assert refusal(tmp_path / "out") is None


def test_a_sound_recording_is_not_touched(source, tmp_path):
    out = tmp_path / "out.csv"
    take(lambda: write_text(out, "frame,t\n"), source, [out], "skip", sha256(source).upper())
    assert out.read_text() == "frame,t\n"
    assert refusal(out) is None


def test_a_wrong_checksum_refuses_the_recording(source, tmp_path):
    with pytest.raises(InputError, match=r"video\.mp4: SHA-256 is [0-9a-f]{64}; 0{64} expected"):
        take(pytest.fail, source, [tmp_path / "out"], "stop", "0" * 64)
    take(pytest.fail, source, [tmp_path / "out"], "skip", "0" * 64)
    assert "SHA-256" in refusal(tmp_path / "out")


@pytest.mark.parametrize("data", [b"", b"\0\1", b'{\n  "refused": ', b'{"recording": 1}', b"frame,t\n0,0\n"])
def test_other_files_are_no_refusals(tmp_path, data):
    (tmp_path / "out").write_bytes(data)
    assert refusal(tmp_path / "out") is None


def test_divide(tmp_path):
    write_json(tmp_path / "1" / "angles.json", {"recording": "1"})
    take(refuse(tmp_path / "no"), tmp_path / "no", [tmp_path / "2" / "angles.json"], "skip")
    kept, refused = divide([tmp_path / "1" / "angles.json", tmp_path / "2" / "angles.json"])
    assert kept == [tmp_path / "1" / "angles.json"]
    assert list(refused) == ["2"]
    with pytest.raises(InputError, match=r"all 1 are left out; the first: .*is spoiled"):
        divide([tmp_path / "2" / "angles.json"])


def test_the_command_line_leaves_out_a_bad_table(tmp_path, capsys):
    (tmp_path / "1.csv").write_text("1,2,3\n")
    arguments = ["import-markers", str(tmp_path / "1.csv"), "--output", str(tmp_path / "m.csv"), "--settings", "{}"]
    assert cli.main(arguments) == 2
    assert cli.main([*arguments, "--on-bad-recording", "skip"]) == 0
    assert "left out: " in capsys.readouterr().err
    angles = [tmp_path / "1" / "angles.csv", tmp_path / "1" / "angles.json"]
    arguments = ["measure-angles", str(tmp_path / "m.csv"), "--output", str(angles[0]), "--summary", str(angles[1])]
    assert cli.main([*arguments, "--settings", "{}", "--on-bad-recording", "skip"]) == 0
    assert "column x_green is missing" in json.loads(angles[1].read_text())["refused"]
    table = ["summarise-recordings", str(angles[1]), "--output", str(tmp_path / "s.csv"), "--markdown", "s.md"]
    assert cli.main(table) == 2
    assert "all 1 are left out" in capsys.readouterr().err
