"""JSON and TOML from strangers: a value, or one line that says what is wrong."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.files.parsing import MOST_BYTES, UnreadableError, parse_json, parse_toml, read_text


@pytest.mark.parametrize(
    "text", ["", "{", "[" * 100_000, '{"a":' * 30_000, "9" * 6000, "NaN", "[Infinity]", "\x00", '{"a": 1' + "}" * 3]
)
def test_what_is_not_json_is_one_short_line(text: str) -> None:
    with pytest.raises(UnreadableError, match=r"^not valid JSON: ") as caught:
        parse_json(text)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "text", ["[a", "a = " + "[" * 5000, "a = " + "9" * 5000, ".".join("a" * 200) + " = 1", "a\x00"]
)
def test_what_is_not_toml_is_one_short_line(text: str) -> None:
    with pytest.raises(UnreadableError, match=r"^not valid TOML: ") as caught:
        parse_toml(text)
    assert "\n" not in str(caught.value)


def test_values_pass() -> None:
    assert parse_json('{"a": [1, 2.5, null, "x"]}') == {"a": [1, 2.5, None, "x"]}
    assert parse_toml("a.b = [1, 2]\n") == {"a": {"b": [1, 2]}}


@given(st.text(max_size=200))
def test_any_text_is_a_value_or_refused(text: str) -> None:
    for parse in (parse_json, parse_toml):
        with suppress(UnreadableError):
            parse(text)


def test_files_are_utf_8_of_a_size(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"\xef\xbb\xbfgr\xc3\xbcn")
    assert read_text(path) == "grün"
    path.write_bytes(b"one\ngr\xfcn")
    with pytest.raises(UnreadableError, match="line 2 is not UTF-8"):
        read_text(path)
    with path.open("wb") as file:
        file.truncate(MOST_BYTES + 1)
    with pytest.raises(UnreadableError, match="larger than 16 MB"):
        read_text(path)
