"""One file of the configuration: what is refused, in one line that names the file and where it can the line."""

from __future__ import annotations

import pytest

from expertaug.config.yaml_file import read
from expertaug.errors import InputError

DEEP = "".join(f"{' ' * k}a:\n" for k in range(100))
ALIASES = "".join(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12))
CHAIN = "".join(f"a{k}: &a{k} [*a{k - 1}]\n" for k in range(1, 900))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "holds no keys"),
        ("# nothing but a comment\n", "holds no keys"),
        ("seeds: [1\nrun: x\n", r":2:\d+: not YAML"),
        ("seeds: [1]\nrun: [a]\nseeds: [2]\n", ":3: 'seeds' is there twice, first in line 1"),
        ("experiments:\n  x:\n    a: 1\n    a: 2\n", ":4: 'a' is there twice, first in line 3"),
        ("a: &a [*a]\n", ":1: an anchor that holds itself"),
        ("experiments: &a {pendulum: *a}\n", ":1: an anchor that holds itself"),
        (f"a: {'[' * 3000}{']' * 3000}\n", "nested more than 40 levels deep"),
        (f"a:\n  {'- ' * 3000}x\n", "nested more than 40 levels deep"),
        (DEEP, "nested more than 40 levels deep"),
        (f"a0: &a0 [1]\n{CHAIN}", "nested more than 40 levels deep"),
        (f"a0: &a0 [x, x, x, x, x, x, x, x, x]\n{ALIASES}", "more than 100000 values"),
        (f"seeds: [{'1' * 5000}]\n", ":1:9: not YAML .a number of too many digits"),
        ("results: 2020-13-45\n", r":1:10: not YAML .month must be in 1\.\.12"),
        (f"results: {'x' * 2**21}\n", "more than 1048576 bytes"),
        ("- 1\n", "a configuration is a mapping"),
        ("{[1]: 2}\n", ":1: a key that is no text"),
    ],
)
def test_a_file_that_cannot_be_used_is_one_line(tmp_path, text, expected):
    path = tmp_path / "a.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=expected) as caught:
        read(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_a_file_of_another_encoding_is_one_line(tmp_path):
    (tmp_path / "a.yaml").write_bytes("results: x".encode("utf-16"))
    with pytest.raises(InputError, match=r"a\.yaml: is not text in UTF-8 .*; save it as UTF-8"):
        read(tmp_path / "a.yaml")


@pytest.mark.parametrize("name", ["none.yaml", ".", "a\0b"])
def test_a_file_that_cannot_be_read_is_one_line(tmp_path, name):
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path / name)


def test_merged_keys_of_an_anchor_may_be_overridden(tmp_path):
    (tmp_path / "a.yaml").write_text("a: &a {x: 1, y: 2}\nb:\n  <<: *a\n  y: 3\n")
    assert read(tmp_path / "a.yaml")["b"] == {"x": 1, "y": 3}


def test_a_file_that_is_not_yaml_is_named_with_its_line(tmp_path):
    path = tmp_path / "a.yaml"
    path.write_text("seeds: [1\nrun: x\n")
    with pytest.raises(InputError, match=r"a\.yaml:2:\d+: not YAML"):
        read(path)
    path.write_text("- 1\n")
    with pytest.raises(InputError, match="a configuration is a mapping"):
        read(path)
    with pytest.raises(InputError, match="cannot be read"):
        read(tmp_path / "none.yaml")
