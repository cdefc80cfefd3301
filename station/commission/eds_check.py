"""Whether davpc can drive a device, by its EDS alone: what bring-up needs, looked for without a bus."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from common.canopen.eds import DeviceFile, initial_value, load_device_file
from common.canopen.frames import mapping
from common.canopen.node import find_eds
from common.config import Config
from common.errors import ConfigError
from follower.can_bridge.axes import Axis
from follower.can_bridge.robot_axes import make_axes

Objects = tuple[tuple[int, int, bool], ...]
"""Index, sub-index, and whether it is written."""
_COMMON: Objects = ((0x1000, 0, False), (0x1018, 1, False), (0x1018, 2, False), (0x1017, 0, True))
_GUARD: Objects = ((0x1016, 1, True), (0x1029, 1, True))


@dataclass(frozen=True)
class EdsReport:
    """What one file lacks for one use, in the order of bring-up; nothing: davpc can drive the device."""

    file: str
    use: str
    missing: tuple[str, ...]


def check_drive(path: Path, config: Config) -> list[EdsReport]:
    """What a drive's EDS lacks, for wheels, joints and lift.

    Raises:
        ConfigError: not an EDS.
    """
    axes = make_axes(config.follower_can, config.base)
    uses = (("wheel", axes[0]), ("joint, gripper", axes[2]), ("lift", axes[10]))
    found = load_device_file(path, axes[0].node_id)
    return [EdsReport(path.name, use, _lacking(found, axis)) for use, axis in uses]


def missing_objects(config: Config, config_path: Path) -> list[str]:
    """What the configured drives' EDS lacks, and what the I/O modules' do.

    Raises:
        ConfigError: a file is missing or not an EDS.
    """
    can = config.follower_can
    drive = find_eds(can.drive_eds, config_path)
    texts = [
        f"{report.file} ({report.use}): {text}" for report in check_drive(drive, config) for text in report.missing
    ]
    for name, node_id in ((can.io_eds, can.io_node_id), (config.leader_can.io_eds, config.leader_can.io_node_id)):
        found = load_device_file(find_eds(name, config_path), node_id)
        texts += [f"{name}: {text}" for text in _absent(found, (*_COMMON, *_GUARD))]
    return list(dict.fromkeys(texts))


def _lacking(found: DeviceFile, axis: Axis) -> tuple[str, ...]:
    written = tuple((index, subindex, True) for index, subindex, _ in axis.parameters())
    read: Objects = ((0x6076, 0, False), (0x6041, 0, False), (0x6064, 0, False))
    texts = _absent(found, (*_COMMON, *_GUARD, *written, *read))
    for number, objects in enumerate(axis.transmit_pdos()):
        texts += _unmapped(found, 0x1800 + number, objects)
    return tuple(texts + _unmapped(found, 0x1400, axis.receive_pdo()))


def _absent(found: DeviceFile, objects: Objects) -> list[str]:
    texts = []
    for index, subindex, write in objects:
        variable = found.dictionary.get_variable(index, subindex)
        if variable is None:
            texts.append(found.flaws.get((index, subindex), f"no object {index:04X}h:{subindex:02X}"))
        elif write and not variable.writable:
            texts.append(f"object {index:04X}h:{subindex:02X} is read-only")
    return texts


def _unmapped(found: DeviceFile, parameter: int, objects: Sequence[tuple[int, int, int]]) -> list[str]:
    """What keeps these objects from being this PDO."""
    table = parameter + 0x200
    texts = _absent(found, ((parameter, 1, False), (parameter, 2, False), (table, 0, False)))
    if texts:
        return texts
    wanted = [len(objects), *(mapping(*entry) for entry in objects)]
    variables = [found.dictionary.get_variable(table, subindex) for subindex in range(len(wanted))]
    fixed = any(variable is None or not variable.writable for variable in variables)
    if fixed and [None if v is None else initial_value(v) for v in variables] != wanted:
        needed = ", ".join(f"{index:04X}h:{subindex:02X}" for index, subindex, _ in objects)
        return [f"mapping {table:04X}h is fixed, and is not {needed}"]
    return _absent(found, tuple((index, subindex, False) for index, subindex, _ in objects))


def refusal(path: Path, config: Config) -> list[EdsReport]:
    """As :func:`check_drive`, with a file that is no EDS as a report."""
    try:
        return check_drive(path, config)
    except ConfigError as error:
        return [EdsReport(path.name, "any", (str(error),))]
