"""EDS and DCF files as they are in the field: each reads as the plain file does, or names what is wrong with it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import canopen
import pytest

from common.canopen.eds import initial_value, load_device_file, parse_number
from common.errors import ConfigError

PLAIN = Path(__file__).parents[4] / "deploy/config/davpc-drive-402.eds"
NODE = 5


def _objects(path: Path) -> dict[tuple[int, int], tuple[Any, ...]]:
    dictionary = load_device_file(path, NODE).dictionary
    found: dict[tuple[int, int], tuple[Any, ...]] = {}
    for index in dictionary:
        entry = dictionary[index]
        single = isinstance(entry, canopen.objectdictionary.ODVariable)
        for part in [entry] if single else entry.values():
            kept = (part.data_type, part.access_type, initial_value(part), part.min, part.max, part.pdo_mappable)
            found[index, part.subindex] = kept
    return found


def _written(folder: Path, change: Callable[[str], str], encoding: str = "utf-8") -> Path:
    path = folder / "maker.eds"
    path.write_bytes(change(PLAIN.read_text(encoding="utf-8")).encode(encoding))
    return path


@pytest.mark.parametrize(
    ("change", "encoding"),
    [
        (lambda text: text, "utf-8-sig"),
        (lambda text: text, "utf-16"),
        (lambda text: text.replace("ParameterName=Device type", "ParameterName=Gerätetyp °"), "cp1252"),
        (lambda text: text.replace("ObjectType=0x7", "ObjectType=07"), "utf-8"),
        (lambda text: text.replace("ParameterName", "parametername").replace("[60", "[  60"), "utf-8"),
        (lambda text: text.replace("=", " = ").replace("\n", "  ; a note\n"), "utf-8"),
        (lambda text: text.replace("\n", "\r\n"), "utf-8"),
        (lambda text: text.replace("[1000]", "a line that is nothing\n# another\n[1000]"), "utf-8"),
        (lambda text: text.replace("[DeviceInfo]", "[Comments]\nLines=9\n[DeviceInfo]\nBaudRate_10=yes"), "utf-8"),
        (lambda text: text.replace("AccessType=rw", "AccessType=RW"), "utf-8"),
        (lambda text: text + "\n[2FFF]\nParameterName=odd\nDataType=what\nAccessType=rw\n", "utf-8"),
    ],
    ids=["bom", "utf16", "cp1252", "octal", "case", "notes", "crlf", "noise", "comments", "access", "foreign"],
)
def test_a_file_as_makers_write_it_reads_as_the_plain_one(
    tmp_path: Path, change: Callable[[str], str], encoding: str
) -> None:
    assert _objects(_written(tmp_path, change, encoding)) == _objects(PLAIN)


def test_what_cannot_be_read_is_named_by_section_and_key(tmp_path: Path) -> None:
    odd = _written(tmp_path, lambda text: text.replace("[6040]\n", "[6040]\nDataType=??\n[6041]\n", 1))
    found = load_device_file(odd, NODE)
    assert found.flaws[0x6040, 0] == "[6040] DataType: '??' cannot be read"
    assert found.dictionary.get_variable(0x6060, 0) is not None


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("07", 7),
        ("055808", 55808),
        ("0X10", 16),
        (" 0x1A ", 26),
        ("$NODEID+0x180", 0x185),
        ("0x180 + $NodeId", 0x185),
        ("0x40000180+$NODEID", 0x40000185),
        ("-3", -3),
        ("100UL", 100),
        ("1.5", None),
        ("", None),
        ("9" * 90, None),
    ],
)
def test_numbers_are_read_as_makers_write_them(text: str, value: int | None) -> None:
    assert parse_number(text, NODE) == value


def test_negative_numbers_may_be_given_as_twos_complement(tmp_path: Path) -> None:
    text = "\n[2000]\nParameterName=x\nDataType=0x3\nAccessType=rw\nDefaultValue=0xFFFE\n"
    assert _objects(_written(tmp_path, lambda plain: plain + text))[0x2000, 0][2] == -2


def test_the_value_of_a_dcf_counts_before_the_default(tmp_path: Path) -> None:
    dcf = _written(tmp_path, lambda text: text.replace("[6072]\n", "[6072]\nParameterValue=700\n"))
    assert _objects(dcf)[0x6072, 0][2] == 700


def test_a_compact_array_has_its_entries_and_no_more(tmp_path: Path) -> None:
    text = "\n[2000]\nParameterName=x\nObjectType=8\nDataType=7\nAccessType=rw\nCompactSubObj=3\nDefaultValue=4\n"
    found = _objects(_written(tmp_path, lambda plain: f"{plain}{text}\n[2000Value]\nNrOfEntries=1\n2=9\n"))
    assert [found[0x2000, n][2] for n in range(4)] == [3, 4, 9, 4]
    assert (0x2000, 4) not in found


@pytest.mark.parametrize(
    ("info", "own", "expected"),
    [("0x402", "0x402", (0x402,)), ("0x402", "0x10402", (0x10402, 0x402)), ("", "", ()), ("", "0x7", (7,))],
)
def test_the_identity_is_read_from_both_places(
    tmp_path: Path, info: str, own: str, expected: tuple[int, ...]
) -> None:
    def change(text: str) -> str:
        head, mark, tail = text.partition("[1018sub2]")
        head = "\n".join(
            f"ProductNumber={info}" if line.startswith("ProductNumber=") else line for line in head.splitlines()
        )
        return f"{head}\n{mark}\nDefaultValue={own}\n{tail.replace('DefaultValue', 'Remark', 1)}"

    assert load_device_file(_written(tmp_path, change), NODE).identity["product"] == expected


def test_a_folder_in_place_of_a_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be read"):
        load_device_file(tmp_path, NODE)
