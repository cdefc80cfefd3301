"""A robot whose drives come from other makers: their EDS on both sides, bring-up as on the robot."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from common.errors import DeviceError
from tests.rigs.canbus_rig import DRIVE_EDS, follower_rig, rig_with, stepped_config

Change = Callable[[str], str]


def _default(section: str, value: str, access: str = "") -> Change:
    """Another default value, and perhaps another access, of one object."""

    def change(text: str) -> str:
        head, body = re.split(rf"(?m)^\[{section}\]\n", text, maxsplit=1)
        here, end, rest = body.partition("\n[")
        here = re.sub(r"(?m)^DefaultValue=.*\n?", "", here) + f"\nDefaultValue={value}"
        if access:
            here = re.sub(r"(?m)^AccessType=.*$", f"AccessType={access}", here)
        return f"{head}[{section}]\n{here}\n{end}{rest}"

    return change


def _without(index: str) -> Change:
    return lambda text: re.sub(rf"(?ms)^\[{index}(sub[0-9A-F]+)?\]\n.*?(?=^\[|\Z)", "", text)


def _enabled(folder: Path, *changes: Change) -> bool:
    text = DRIVE_EDS.read_text(encoding="utf-8")
    for change in changes:
        text = change(text)
    (folder / "maker.eds").write_text(text, encoding="utf-8")
    drives = stepped_config().follower_can.model_copy(update={"drive_eds": str(folder / "maker.eds")})
    with rig_with(drives) as rig:
        measured = rig.enable()
        return measured.wheels_enabled and measured.arms_enabled


@pytest.mark.parametrize(
    "changes",
    [
        (_default("1800sub1", "$NODEID+0xC0000180"), _default("1801sub1", "0xC0000280+$NODEID")),
        (_default("1800sub1", "$NODEID+0x40000180"),),
        (
            _default("1801sub1", "$NODEID+0x40000280", "ro"),
            _default("1801sub2", "1", "ro"),
            _default("1A01sub0", "1", "ro"),
            _default("1A01sub1", "0x60640020", "ro"),
        ),
        (_default("1018sub2", "0x10402"),),
        (_default("1018sub1", "0"), lambda text: text.replace("VendorNumber=", "Vendor=")),
        (lambda text: text.replace("[1016sub1]\n", "[1016sub1]\nHighLimit=65535\n"),),
    ],
    ids=["no-rtr", "valid-no-rtr", "fixed-pdo", "two-identities", "no-identity", "wrong-limit"],
)
def test_a_drive_that_differs_where_it_may_comes_into_operation(tmp_path: Path, changes: tuple[Change, ...]) -> None:
    assert _enabled(tmp_path, *changes)


@pytest.mark.parametrize("index", ["6072", "1029", "6007", "605A", "6076", "1A00"])
def test_a_drive_without_a_needed_object_is_refused_by_its_name(tmp_path: Path, index: str) -> None:
    with pytest.raises(DeviceError, match=rf"maker.eds: no object {index}h:0[01], needed by left wheel"):
        _enabled(tmp_path, _without(index))


def test_a_third_number_is_refused_with_the_eds_as_the_place_to_look() -> None:
    with follower_rig() as rig:
        rig.robot.left_wheel.values[0x1018, 2] = 7
        with pytest.raises(DeviceError, match=r"product is 7 \(0x7\), expected 1026 .* by davpc-drive-402.eds"):
            rig.drives.open()


def test_a_mapping_that_cannot_change_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(DeviceError, match=r"1A00h:00: write of 3 refused: .*has to be 6041h:00, 606Ch:00, 6077h:00"):
        _enabled(tmp_path, _default("1A00sub0", "0", "ro"))
