"""Marker CSVs and archives with what a spreadsheet, a script or an enemy puts there."""

from __future__ import annotations

import gzip
import io
import struct
import tarfile
import zlib
from collections.abc import Iterator

from damaged.base import EITHER, REFUSED, Case, tar_of, zip_of


def tables(table: bytes) -> Iterator[Case]:
    """Marker CSVs with what a spreadsheet, a script or an enemy puts there."""
    rows = [row.split(b",") for row in table.splitlines()]

    def with_cell(value: bytes) -> bytes:
        return b"\n".join(b",".join([*row[:2], value, *row[3:]] if k == 7 else row) for k, row in enumerate(rows))

    cells = {
        "text": b"lost", "nothing": b"", "nan": b"nan", "inf": b"-inf", "1e999": b"1e999", "1e308": b"1e308",
        "-1e300": b"-1e300", "a million digits": b"9" * 10**6, "long text": b"x" * 10**5, "NUL": b"97\x007",
        "underscore": b"9_77", "hexadecimal": b"0x3d1", "other digits": "٩٧٧".encode(), "comma": b'"977,5"',
        "line break": b'"977\n5"', "open quote": b'"977', "escape": b"\x1b[2J", "formula": b"=1+1",
        "latin-1": b"9\xe477", "complex": b"1j", "true": b"True", "date": b"2018-01-01",
    }  # fmt: skip
    for name, value in cells.items():
        yield Case(f"cell: {name}", "markers", "csv", ".csv", with_cell(value))
    whole = {
        "columns x before y of other colours": [[r[3], r[0], r[5], r[2], r[1], r[4]] for r in rows],
        "five columns": [r[:5] for r in rows],
        "seven columns": [[*r, b"1"] for r in rows],
        "one short row": [r[: 3 if k == 9 else 6] for k, r in enumerate(rows)],
        "an empty row": [[] if k == 9 else r for k, r in enumerate(rows)],
        "header": [[b"y_red", b"x_red", b"y_green", b"x_green", b"y_blue", b"x_blue"], *rows],
        "all zero": [[b"0"] * 6 for _ in rows],
        "one point": [rows[0][:2] * 3 for _ in rows],
        "all 1e308": [[b"1e308", b"-1e308"] * 3 for _ in rows],
        "all 1e-320": [[b"1e-320", b"2e-320"] * 3 for _ in rows],
        "noise": [[str((r * r * (c + 3) * 7919) % 2400).encode() for c in range(6)] for r in range(60)],
    }
    for name, content in whole.items():
        yield Case(f"table: {name}", "markers", "csv", ".csv", b"\n".join(b",".join(r) for r in content))
    text = table.decode()
    bytes_of = {
        "UTF-16": text.encode("utf-16"), "UTF-32": text.encode("utf-32"), "semicolons": table.replace(b",", b";"),
        "tabs": table.replace(b",", b"\t"), "decimal commas": table.replace(b"\n", b",5\n"),
        "binary": bytes(range(256)),
        "empty": b"", "only line breaks": b"\n" * 1000, "only commas": b",,,,,\n" * 100, "NULs": bytes(1000),
        "a million commas": b"," * 10**6, "one endless row": b"1," * 10**5,
    }  # fmt: skip
    for name, data in bytes_of.items():
        yield Case(f"file: {name}", "markers", "csv", ".csv", data)
    for name, data in {
        "byte order mark": b"\xef\xbb\xbf" + table,
        "carriage returns": table.replace(b"\n", b"\r\n"),
        "old Macintosh": table.replace(b"\n", b"\r"),
        "blank end": table + b"\n\n",
        "spaces": table.replace(b",", b" , "),
    }.items():
        yield Case(f"file: {name}", "markers", "csv", ".csv", data, EITHER)


def archives(table: bytes) -> Iterator[Case]:
    """Archives that leave their folder, link, burst or lie."""
    for make, suffix in ((tar_of, ".tar.gz"), (zip_of, ".zip")):
        for name, members in {
            "..": {"../1.csv": table},
            ".. within": {"a/../../1.csv": table},
            "absolute": {"/tmp/1.csv": table},
            "drive": {"C:\\1.csv": table},
            "no CSV": {"readme.txt": table},
            "no member": {},
            "two of one name": {"a/1.csv": table, "b/1.csv": table},
            "two that differ in case": {"a/x.csv": table, "b/X.csv": table},
            "file and folder of one name": {"1.csv": table, "1.csv/2.csv": table},
            "long name": {"a" * 300 + ".csv": table},
            "line break in a name": {"1\n2.csv": b""},
            "hidden": {".1.csv": table, "__MACOSX/2.csv": table},
        }.items():
            yield Case(f"archive{suffix}: {name}", "archive", "", suffix, make(members), _loose(name))
    for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.FIFOTYPE):

        def link(info: tarfile.TarInfo, kind: bytes = kind) -> None:
            info.type, info.linkname, info.size = kind, "/etc/passwd", 0

        yield Case(f"archive: member of type {kind!r}", "archive", "", ".tar.gz", tar_of({"1.csv": b""}, link))
    yield Case("archive: link in a zip", "archive", "", ".zip", zip_of({"1.csv": b"/etc/passwd"}, 0o120777))
    yield Case("archive: same member twice", "archive", "", ".tar.gz", _doubled(table))
    yield Case("archive: header of 3 GiB", "archive", "", ".tar.gz", _vast_header())
    yield Case("archive: a million members", "archive", "", ".tar.gz", _many_members())
    for name in ("1.csv", "x.bin"):
        yield Case(f"archive: {name} of 64 GiB of zeros", "archive", "", ".tar.gz", _bomb(name, table))
    yield Case("archive: zip of 2 GiB of zeros", "archive", "", ".zip", _zip_bomb())
    packed = zip_of({"1.csv": table})
    lying = packed.replace(struct.pack("<I", len(table)), struct.pack("<I", 10))
    yield Case("archive: zip that lies about sizes", "archive", "", ".zip", lying)
    yield Case(
        "archive: encrypted zip", "archive", "", ".zip", packed.replace(b"\x14\0\0\0\x08\0", b"\x14\0\x01\0\x08\0")
    )


def _loose(name: str) -> str:
    return EITHER if name == "line break in a name" else REFUSED


def _doubled(table: bytes) -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode="w:gz") as tar:
        for rows in (table, table[::-1]):
            info = tarfile.TarInfo("1.csv")
            info.size = len(rows)
            tar.addfile(info, io.BytesIO(rows))
    return out.getvalue()


def _zeros(count: int) -> bytes:
    """Gzip of zeros; a gzip file may be a row of many."""
    some = gzip.compress(bytes(2**26), mtime=0)
    return some * (count // 2**26)


def _bomb(name: str, table: bytes) -> bytes:
    first, second = tarfile.TarInfo("0.csv"), tarfile.TarInfo(name)
    first.size, second.size = len(table), 2**36
    start = first.tobuf(tarfile.USTAR_FORMAT) + table + bytes(-len(table) % 512) + second.tobuf(tarfile.GNU_FORMAT)
    return gzip.compress(start, mtime=0) + _zeros(2**36)


def _zip_bomb() -> bytes:
    """A zip whose one member unpacks to 2 GiB; made by hand, because packing so much takes long."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    some = packer.compress(bytes(2**26)) + packer.flush(zlib.Z_FULL_FLUSH)
    data = some * 32 + packer.flush()
    header = struct.pack("<HHHHHIII", 20, 0, 8, 0, 33, 0, len(data), 2**31) + struct.pack("<HH", 5, 0)
    local = b"PK\3\4" + header + b"1.csv" + data
    central = b"PK\1\2" + struct.pack("<H", 20) + header + struct.pack("<HHHII", 0, 0, 0, 0, 0) + b"1.csv"
    return local + central + b"PK\5\6" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), len(local), 0)


def _vast_header() -> bytes:
    info = tarfile.TarInfo("x")
    info.type, info.size = tarfile.XHDTYPE, 3 * 2**30
    return gzip.compress(info.tobuf(tarfile.USTAR_FORMAT), mtime=0) + _zeros(3 * 2**30)


def _many_members() -> bytes:
    info = tarfile.TarInfo("x.csv").tobuf()
    return gzip.compress(info * 2**11, mtime=0) * 512
