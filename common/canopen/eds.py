"""EDS and DCF files as makers write them (CiA 306), read object by object: a flaw refuses only what it spoils.

The library's reader takes a file by the caller's locale and refuses it whole for one odd line. Here the text is read
line by line, each object that can be understood is written again in the strict form, and the library reads that.
"""

from __future__ import annotations

import io
import re
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import canopen
from canopen.objectdictionary import NUMBER_TYPES, datatypes
from canopen.objectdictionary.eds import import_eds

from common.errors import ConfigError
from common.files.parsing import one_line

Key = tuple[int, int]
_Keys = dict[str, str]
_MOST_BYTES = 8_000_000
_MOST_ENTRIES = 254
_RECORD = "0x9"
_DOMAIN_OBJECT = 2
_LAST_SIMPLE_TYPE = 0x1B
_OBJECT = re.compile(r"([0-9a-f]{4})(?:\s*sub\s*([0-9a-f]{1,2}))?")
_NUMBER = re.compile(r"([+-]?)(?:0x([0-9a-f]+)|([0-9]+))")
_ACCESS = ("ro", "wo", "rw", "rwr", "rww", "const")
_IDENTITY = (("vendor", "vendornumber", 1), ("product", "productnumber", 2))


@dataclass(frozen=True)
class DeviceFile:
    """What an EDS or DCF says of a device with one node id.

    Attributes:
        dictionary: a ``canopen.ObjectDictionary``; do not change it.
        identity: numbers that the file gives for vendor and product, in [DeviceInfo] and in 1018h; one where both
            agree, none where neither gives one.
        flaws: by object, what of it cannot be read: section and key.
    """

    dictionary: Any
    identity: dict[str, tuple[int, ...]]
    flaws: dict[Key, str] = field(default_factory=dict)


@lru_cache(maxsize=64)
def load_device_file(path: Path, node_id: int) -> DeviceFile:
    """Read an EDS, or a DCF, for one node id.

    Raises:
        ConfigError: the file is missing, too large, or describes no object.
    """
    sections = _sections(_text(path))
    if not sections:
        raise ConfigError(f"{path}: not an EDS: File contains no section headers")
    flaws: dict[Key, str] = {}
    objects: dict[Key, _Keys] = {}
    for name, keys in sections.items():
        match = _OBJECT.fullmatch(name)
        if match is not None:
            objects[int(match[1], 16), -1 if match[2] is None else int(match[2], 16)] = keys
    strict = _strict_text(objects, sections, node_id, flaws)
    try:
        read: Any = import_eds
        dictionary = read(io.StringIO(strict), node_id)
    except Exception as error:  # the parser raises many kinds of errors
        raise ConfigError(f"{path}: not an EDS: {one_line(str(error))}") from error
    if not dictionary.names:
        raise ConfigError(f"{path}: not an EDS: it describes no object")
    return DeviceFile(dictionary, _identity(sections.get("deviceinfo", {}), dictionary), flaws)


def parse_number(text: str, node_id: int = 0) -> int | None:
    """A number as EDS files give it: hexadecimal with 0x, else decimal, also with leading zeros, or ``$NODEID+…``."""
    bare = re.sub(r"\s", "", text).lower().rstrip("ul")
    value, parts = 0, bare.split("+") if "$nodeid" in bare else [bare]
    for part in parts:
        match = _NUMBER.fullmatch(part)
        if part == "$nodeid":
            value += node_id
        elif match is None or len(part) > 24:
            return None
        else:
            size = int(match[2], 16) if match[2] is not None else int(match[3])
            value += -size if match[1] == "-" else size
    return value


def _text(path: Path) -> str:
    """UTF-8 with or without its mark, UTF-16 by its mark, else Windows-1252: never by the caller's locale."""
    try:
        with path.open("rb") as file:
            data = file.read(_MOST_BYTES + 1)
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > _MOST_BYTES:
        raise ConfigError(f"{path}: not an EDS: larger than {_MOST_BYTES // 1_000_000} MB")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")


def _sections(text: str) -> dict[str, _Keys]:
    """Sections and keys in lower case; lines that are neither are passed over, the last of two values counts."""
    found: dict[str, _Keys] = {}
    current: _Keys = {}
    for raw in re.split(r"\r\n|\r|\n", text):
        line = raw.strip().strip("\0")
        if line.startswith("["):
            name = line[1:].partition("]")[0].strip().lower()
            current = found.setdefault(name, {})
        elif line and line[0] not in ";#":
            key, equals, value = line.partition("=")
            if equals:
                current[key.strip().lower()] = value.partition(";")[0].strip().strip('"').strip()
    return found


def _strict_text(objects: dict[Key, _Keys], sections: dict[str, _Keys], node_id: int, flaws: dict[Key, str]) -> str:
    """Every object that can be understood, in the form that the library reads; the others go to ``flaws``."""
    lines = ["[DeviceInfo]"]  # without it the library logs a warning
    for index in sorted({index for index, _ in objects}):
        head = objects.get((index, -1), {})
        parts = {subindex: keys for (other, subindex), keys in objects.items() if other == index and subindex >= 0}
        compact = parse_number(head.get("compactsubobj", "")) or 0
        for subindex in range(1, min(compact, _MOST_ENTRIES) + 1):
            parts.setdefault(subindex, head | _compact(sections, index, subindex))
        if compact:
            parts.setdefault(0, {"datatype": "5", "accesstype": "ro", "defaultvalue": str(compact)})
        if not parts:
            lines += _variable(f"{index:04X}", (index, 0), head, sections, node_id, flaws)
            continue
        lines += [f"[{index:04X}]", f"ParameterName={_name(head, index)}", f"ObjectType={_RECORD}"]
        for subindex, keys in sorted(parts.items()):
            lines += _variable(f"{index:04X}sub{subindex:X}", (index, subindex), keys, sections, node_id, flaws)
    return "\n".join(lines) + "\n"


def _compact(sections: dict[str, _Keys], index: int, subindex: int) -> _Keys:
    """What the sections ``…Value`` of a compact array give for one entry (CiA 306, 4.6.3)."""
    value = sections.get(f"{index:04x}value", {}).get(str(subindex))
    return {} if value is None else {"defaultvalue": value}


def _variable(
    section: str, key: Key, keys: _Keys, sections: dict[str, _Keys], node_id: int, flaws: dict[Key, str]
) -> list[str]:
    kind, access = _data_type(keys, sections), keys.get("accesstype", "").lower()
    if kind is None:
        flaws[key] = f"[{section}] DataType: {_shown(keys.get('datatype'))}"
        return []
    if access not in _ACCESS:
        flaws[key] = f"[{section}] AccessType: {_shown(keys.get('accesstype'))}"
        return []
    lines = [f"[{section}]", f"ParameterName={_name(keys, key[0])}", "ObjectType=0x7", f"DataType={kind:#x}"]
    lines += [f"AccessType={access}", f"PDOMapping={int(bool(parse_number(keys.get('pdomapping', '0'))))}"]
    if kind not in NUMBER_TYPES:
        text = keys.get("parametervalue") or keys.get("defaultvalue", "")
        return [*lines, f"DefaultValue={one_line(text)}"] if text and kind == datatypes.VISIBLE_STRING else lines
    for name in ("LowLimit", "HighLimit", "DefaultValue", "ParameterValue"):
        given = keys.get(name.lower(), "")
        if not given:
            continue
        value = _fitting(parse_number(given, node_id), kind)
        if value is not None:
            lines.append(f"{name}={value}")
        elif name.endswith("Value"):
            flaws[key] = f"[{section}] {name}: {_shown(given)}"
    return lines


def _data_type(keys: _Keys, sections: dict[str, _Keys]) -> int | None:
    """The object's simple type; a maker's own type is looked up where the file defines it."""
    kind = parse_number(keys.get("datatype", ""))
    if kind is None and parse_number(keys.get("objecttype", "7")) == _DOMAIN_OBJECT:
        return datatypes.DOMAIN
    if kind is not None and kind > _LAST_SIMPLE_TYPE:
        defined = sections.get(f"{kind:x}sub1") or sections.get(f"{kind:04x}sub1") or {}
        return parse_number(defined.get("defaultvalue", "")) or datatypes.DOMAIN
    return kind if kind else None


def _fitting(value: int | None, kind: int) -> int | None:
    """A number of this type; the hexadecimal form of a negative one is the two's complement."""
    if value is None or kind in datatypes.FLOAT_TYPES:
        return value
    bits = canopen.objectdictionary.ODVariable("", 0)
    bits.data_type = kind
    size = len(bits)
    if kind in datatypes.SIGNED_TYPES and value >= 1 << (size - 1):
        value -= 1 << size
    low, high = (-(1 << (size - 1)), 1 << (size - 1)) if kind in datatypes.SIGNED_TYPES else (0, 1 << size)
    return value if low <= value < high else None


def _identity(information: _Keys, dictionary: Any) -> dict[str, tuple[int, ...]]:
    """Vendor and product from both places; 0 says nothing."""
    found: dict[str, tuple[int, ...]] = {}
    for what, key, subindex in _IDENTITY:
        stated = parse_number(information.get(key, "")) or 0
        variable = dictionary.get_variable(0x1018, subindex)
        own = 0 if variable is None else initial_value(variable) or 0
        found[what] = tuple(dict.fromkeys(number for number in (own, stated) if number))
    return found


def initial_value(variable: Any) -> int | None:
    """Value after switching on: as configured in a DCF, else the maker's default; None if the file gives neither."""
    value = variable.default if variable.value is None else variable.value
    return int(value) if isinstance(value, int | float) else None


def _name(keys: _Keys, index: int) -> str:
    return one_line(keys.get("parametername", "")).replace(";", ",") or f"object {index:04X}h"


def _shown(given: str | None) -> str:
    return "missing" if given is None else f"{one_line(given, 40)!r} cannot be read"
