import io
import tarfile
import zipfile

import numpy as np
import pandas as pd
import pytest
from pendulum_motion import markers, truth

from expertaug.errors import InputError
from expertaug.files import sha256
from expertaug_recordings.ibm import import_markers, list_marker_files, unpack_archive
from expertaug_recordings.settings import ImportMarkersJob, UnpackMarkersJob

ROW = "1201,1221,977,1782,1437,1744\n"


def make_tar(path, names, kind=tarfile.REGTYPE):
    with tarfile.open(path, "w:gz") as tar:
        for name in names:
            info = tarfile.TarInfo(name)
            info.type, info.size, info.linkname = kind, len(ROW) if kind == tarfile.REGTYPE else 0, "/etc/passwd"
            tar.addfile(info, io.BytesIO(ROW.encode()))
    return path


def make_zip(path, names):
    with zipfile.ZipFile(path, "w") as pack:
        for name in names:
            pack.writestr(name, ROW)
    return path


def write_ibm(path, table):
    columns = ["pivot_y", "pivot_x", "joint_y", "joint_x", "tip_y", "tip_x"]
    raw = (table[columns].to_numpy() * 5 + 2).round().astype(int)
    np.savetxt(path, raw, fmt="%d", delimiter=",")
    return raw


def test_files_are_listed_in_natural_order_and_hidden_ones_left_out(tmp_path):
    folder = tmp_path / "original" / "dpc_dataset_csv"
    folder.mkdir(parents=True)
    for name in ("10.csv", "2.csv", "0.CSV", "._0.csv"):
        (folder / name).write_text(ROW)
    (tmp_path / "processed").mkdir()
    (tmp_path / "processed" / "0.csv").write_text("the archive's other tables are not markers")
    assert list(list_marker_files(tmp_path)) == ["0", "2", "10"]


@pytest.mark.parametrize("other", ["b/1.csv", "a/1.CSV"])
def test_two_files_of_one_name(tmp_path, other):
    for name in ("a/1.csv", other):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(ROW)
    with pytest.raises(InputError, match="two files of one name"):
        list_marker_files(tmp_path)


def test_no_markers(tmp_path):
    with pytest.raises(InputError, match="no marker CSV"):
        list_marker_files(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        list_marker_files(tmp_path / "nowhere")


@pytest.mark.parametrize("make", [make_tar, make_zip])
def test_only_csvs_are_unpacked(tmp_path, make):
    names = [
        "dp/original/dpc_dataset_csv/3.csv",
        "dp/original/dpc_dataset_csv/11.csv",
        "dp/README.md",
        "dp/other/3.csv",
    ]
    archive = make(tmp_path / "markers.archive", names)
    found = unpack_archive(archive, tmp_path / "out", UnpackMarkersJob(sha256=sha256(archive)))
    assert list(found) == ["3", "11"]
    assert found["3"].read_text() == ROW
    assert sum(p.is_file() for p in (tmp_path / "out").rglob("*")) == 2


@pytest.mark.parametrize("packing", ["", "gz", "bz2", "xz"])
def test_a_tar_may_be_packed_in_any_way(tmp_path, packing):
    with tarfile.open(tmp_path / "a", f"w:{packing}") as tar:
        tar.addfile(tarfile.TarInfo("1.csv"), io.BytesIO())
    assert list(unpack_archive(tmp_path / "a", tmp_path / "out", UnpackMarkersJob())) == ["1"]


def test_what_might_be_old_lzma_is_not_tried(tmp_path, monkeypatch):
    """Without magic bytes, any header is one, of a dictionary of up to 4 GiB."""
    (tmp_path / "a.zip").write_bytes(b"\x5d\x00\x00\x00\x80" + b"\xff" * 8 + bytes(1000))
    monkeypatch.setattr("lzma.LZMADecompressor", lambda *_, **__: pytest.fail("tried"))
    with pytest.raises(InputError, match="neither a tar nor a zip"):
        unpack_archive(tmp_path / "a.zip", tmp_path / "out", UnpackMarkersJob())


def test_unpacking_replaces_the_folder(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "old.csv").write_text(ROW)
    assert list(unpack_archive(make_tar(tmp_path / "a.tar.gz", ["1.csv"]), tmp_path / "out", UnpackMarkersJob())) == [
        "1"
    ]


@pytest.mark.parametrize("name", ["../1.csv", "a/../../1.csv", "/tmp/1.csv", "C:\\1.csv"])
@pytest.mark.parametrize("make", [make_tar, make_zip])
def test_members_that_would_land_outside(tmp_path, make, name):
    archive = make(tmp_path / "a.archive", ["0.csv", name])
    with pytest.raises(InputError, match="outside of the folder"):
        unpack_archive(archive, tmp_path / "out", UnpackMarkersJob())
    assert [p.name for p in tmp_path.iterdir()] == ["a.archive"]


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE])
def test_links_in_a_tar(tmp_path, kind):
    with pytest.raises(InputError, match="link or a device"):
        unpack_archive(make_tar(tmp_path / "a.tar.gz", ["1.csv"], kind), tmp_path / "out", UnpackMarkersJob())


def test_link_in_a_zip(tmp_path):
    info = zipfile.ZipInfo("1.csv")
    info.external_attr = 0o120777 << 16
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as pack:
        pack.writestr(info, "/etc/passwd")
    with pytest.raises(InputError, match="link or a device"):
        unpack_archive(tmp_path / "a.zip", tmp_path / "out", UnpackMarkersJob())


def test_a_zip_of_too_many_members(tmp_path, monkeypatch):
    monkeypatch.setattr("expertaug_recordings.unpacking.MAX_MEMBERS", 10)
    archive = make_zip(tmp_path / "a.zip", [f"{k}.csv" for k in range(11)])
    with pytest.raises(InputError, match="holds more than 10 members"):
        unpack_archive(archive, tmp_path / "out", UnpackMarkersJob())
    assert [p.name for p in tmp_path.iterdir()] == ["a.zip"]


def test_members_in_deep_folders(tmp_path):
    with pytest.raises(InputError, match="lies 41 folders deep; at most 32 can be used"):
        unpack_archive(make_zip(tmp_path / "a.zip", ["a/" * 40 + "1.csv"]), tmp_path / "out", UnpackMarkersJob())


def test_what_a_killed_job_left_goes_with_the_next(tmp_path, monkeypatch):
    def kill(*_):
        raise SystemExit

    archive = make_zip(tmp_path / "a.zip", ["1.csv"])
    with monkeypatch.context() as patch:
        patch.setattr("expertaug_recordings.ibm.unpack", kill)
        patch.setattr("shutil.rmtree", lambda *_, **__: None)
        with pytest.raises(SystemExit):
            unpack_archive(archive, tmp_path / "out", UnpackMarkersJob())
    assert len(list(tmp_path.iterdir())) == 2
    unpack_archive(archive, tmp_path / "out", UnpackMarkersJob())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.zip", "out"]


def test_wrong_checksum(tmp_path):
    with pytest.raises(InputError, match="SHA-256"):
        archive = make_tar(tmp_path / "a.tar.gz", ["1.csv"])
        unpack_archive(archive, tmp_path / "out", UnpackMarkersJob(sha256="0" * 64))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("damage", ["truncated", "text"])
def test_damaged_archive(tmp_path, damage):
    archive = make_tar(tmp_path / "a.tar.gz", [f"{k}.csv" for k in range(50)])
    archive.write_bytes(archive.read_bytes()[:150] if damage == "truncated" else b"hello")
    with pytest.raises(InputError):
        unpack_archive(archive, tmp_path / "out", UnpackMarkersJob())
    assert not (tmp_path / "out").exists()


def test_two_members_of_one_name(tmp_path):
    with pytest.raises(InputError, match="two files of one name"):
        unpack_archive(make_tar(tmp_path / "a.tar.gz", ["a/1.csv", "b/1.csv"]), tmp_path / "out", UnpackMarkersJob())


def test_markers_are_imported(tmp_path):
    table = markers(truth()[0, :200])
    write_ibm(tmp_path / "1.csv", table)
    import_markers(tmp_path / "1.csv", tmp_path / "markers.csv", ImportMarkersJob(rate_hz=500))
    found = pd.read_csv(tmp_path / "markers.csv")
    assert list(found.columns) == list(table.columns)
    assert np.abs(found["tip_x"] - table["tip_x"]).max() <= 0.1 + 1e-9
    assert np.allclose(found["t"], np.arange(200) / 500)
    assert (found["quality"] == 1).all() and found["reason"].isna().all()


def broken_csv(kind):
    rows = [ROW.strip().split(",") for _ in range(30)]
    if kind == "missing":
        rows[4] = rows[4][:5]
    elif kind == "text":
        rows[6][2] = "lost"
    elif kind == "nan":
        rows[8][5] = "nan"
    elif kind == "empty cell":
        rows[8][0] = ""
    elif kind == "header":
        rows.insert(0, ["y_red", "x_red", "y_green", "x_green", "y_blue", "x_blue"])
    elif kind == "no arm":
        rows[9][4:] = rows[9][2:4]
    elif kind == "wild":
        rows = [[str(100 * (r * r * (c + 1) % 13)) for c in range(6)] for r in range(1, 12)]
    elif kind == "empty":
        rows = []
    return "".join(",".join(row) + "\n" for row in rows)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("missing", "row 5: column x_blue is missing"),
        ("text", "row 7, column y_green: 'lost' is no number"),
        ("nan", "row 9, column x_blue: 'nan' is no number"),
        ("empty cell", "row 9, column y_red: '' is no number"),
        ("header", "row 1, column y_red"),
        ("no arm", "row 10, columns y_blue,x_blue: arm 2 has no length"),
        ("wild", r"row \d+, columns y_(green|blue),x_(green|blue): arm \d"),
        ("empty", "no rows"),
    ],
)
def test_bad_marker_files(tmp_path, kind, message):
    (tmp_path / "1.csv").write_text(broken_csv(kind))
    with pytest.raises(InputError, match=message) as error:
        import_markers(tmp_path / "1.csv", tmp_path / "markers.csv", ImportMarkersJob())
    assert "\n" not in str(error.value)
    assert not (tmp_path / "markers.csv").exists()


def test_unknown_setting(tmp_path):
    with pytest.raises(InputError, match=r"settings\.rate: unknown key"):
        import_markers(tmp_path / "1.csv", tmp_path / "markers.csv", ImportMarkersJob.from_mapping({"rate": 400}))
    with pytest.raises(InputError, match="takes for a text; write"):
        import_markers(tmp_path / "1.csv", tmp_path / "markers.csv", ImportMarkersJob.from_mapping({"rate_hz": "4e2"}))
