"""A simulated CiA 402 drive: state machine, profile velocity, torque and position, ramps, encoder, watchdog reaction.

It gives the plant the motor's set-points and takes the plant's measurements, both at the output shaft; the state
machine is in :mod:`sim.can.power_states`. With homing configured the encoder is incremental: it counts from where
the drive was switched on (:mod:`sim.can.drive_homing`). Not modelled: current control, commutation, temperature; the
plant applies the torque limit.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

from common.config import DriveConfig
from sim.can.drive_homing import HomingRun
from sim.can.drive_profile import approach, ramp
from sim.can.faults import EncoderFault
from sim.can.pdo import Key
from sim.can.power_states import PowerDrive, PowerState

UNDERVOLTAGE = 0x3220
UNDERVOLTAGE_V = 18.0
_REMOTE = 0x0200
_TARGET_REACHED = 0x0400
_BIT_12 = 0x1000
_HOMING_ERROR = 0x2000
_POSITION_MODES = (1, 6)
_INT32 = 1 << 32
Effort = Literal["none", "velocity", "torque", "position"]
_EFFORTS: dict[int, Effort] = {1: "position", 3: "velocity", 4: "torque"}


class Drive402(PowerDrive):
    """One drive. ``units_per_turn`` of the output shaft: 2π rad, or metres for a lead screw.

    Names that end in rad stand for the drive's own unit where that is another.
    """

    def __init__(self, config: DriveConfig, eds: Path, units_per_turn: float = 2 * math.pi) -> None:
        super().__init__(config.node_id, eds, config.serial)
        self._counts_per_unit = config.counts_per_turn * config.gear_ratio * config.sign / units_per_turn
        # encoder counts minus the shaft's; unknown until an incremental encoder is switched on
        self._offset: int | None = None if config.homing else config.zero_counts
        switch = config.homing.position * self._counts_per_unit if config.homing else 0.0
        self._homing = HomingRun(switch)
        self._permille_per_n_m = 1000.0 * config.sign / (config.rated_torque_n_m * config.gear_ratio)
        self.values[0x6076, 0] = round(config.rated_torque_n_m * 1000)
        self.voltage_v = 48.0
        self.encoder = EncoderFault()
        self._velocity = 0.0
        self._torque = 0.0
        self._position = 0.0
        self._position_speed = 0.0
        self._goal: float | None = None
        self._acknowledged = False
        self._hold = 0.0
        self._measured = (0.0, 0.0, 0.0)

    # -- the plant's side

    @property
    def effort(self) -> Effort:
        """Which of the set-points the motor follows; none when it is free."""
        if not self.enabled:
            return "none"
        mode = self.values[0x6061, 0]
        if self.state is not PowerState.OPERATION_ENABLED and mode != 3:
            return "position"
        return _EFFORTS.get(mode, "position")

    @property
    def velocity_setpoint_rad_s(self) -> float:
        """Speed set-point of the output shaft, after its ramp."""
        return self._velocity / self._counts_per_unit

    @property
    def torque_setpoint_n_m(self) -> float:
        """Torque at the output shaft, after slope and limit."""
        return self._torque / self._permille_per_n_m

    @property
    def torque_limit_n_m(self) -> float:
        """Largest torque at the output shaft that max torque (6072h) allows."""
        return self.values[0x6072, 0] / abs(self._permille_per_n_m)

    @property
    def position_setpoint(self) -> float:
        """Position set-point of the output shaft: on its profile, or held where it was stopped."""
        mode = self.values[0x6061, 0]
        held = self.state is not PowerState.OPERATION_ENABLED or mode not in _POSITION_MODES
        return self._hold if held else self._position / self._counts_per_unit

    def set_measured(self, position_rad: float, velocity_rad_s: float, torque_n_m: float) -> None:
        """Take the motion of the plant's output shaft; the encoder quantises it."""
        self._measured = (position_rad, velocity_rad_s, torque_n_m)

    # -- the device's side

    def moved(self, elapsed_s: float) -> None:
        """Advance the profile of the active mode, or the ramp of a stop."""
        if self.voltage_v < UNDERVOLTAGE_V and self.state not in (PowerState.FAULT_REACTION_ACTIVE, PowerState.FAULT):
            self.trip(UNDERVOLTAGE, 0x04)
        if not self.enabled or elapsed_s <= 0.0:
            return
        stopping = self.stopping
        mode = self.values[0x6061, 0]
        if mode == 3:
            self._move_velocity(stopping, elapsed_s)
        elif mode == 4:
            self._torque = 0.0 if stopping else self._move_torque(elapsed_s)
        elif mode == 1 and not stopping:
            self._move_position(elapsed_s)
        elif mode == 6 and not stopping:
            self._move_homing(elapsed_s)
        self.finish_stop()

    def written(self, key: Key) -> None:
        """Act on controlword, mode and targets."""
        if key == (0x6040, 0):
            self.obey(self.values[key])
        elif key == (0x6060, 0) and self.values[key] in (0, 1, 3, 4, 6):
            self.values[0x6061, 0] = self.values[key]

    def sampled(self) -> None:
        """Quantise the measurement and compose the statusword."""
        position, velocity = self.encoder.read(self._measured[0], self._measured[1])
        torque = self._measured[2]
        values = self.values
        if self._offset is None:
            self._offset = -round(position * self._counts_per_unit)
        counts = round(position * self._counts_per_unit) + self._offset
        values[0x6064, 0] = (counts + _INT32 // 2) % _INT32 - _INT32 // 2
        values[0x606C, 0] = round(velocity * self._counts_per_unit)
        values[0x6077, 0] = max(-32768, min(32767, round(torque * self._permille_per_n_m)))
        values[0x6079, 0] = round(self.voltage_v * 1000)
        values[0x6041, 0] = self._statusword()

    # -- the state machine's side

    @property
    def ramping(self) -> bool:
        """Only the velocity set-point has a ramp to zero."""
        return self.values[0x6061, 0] == 3 and self._velocity != 0.0

    def begin(self) -> None:
        """Every profile begins where the shaft is."""
        position, velocity, _ = self._measured
        self._velocity = velocity * self._counts_per_unit
        self._torque = 0.0
        self._position, self._position_speed = position * self._counts_per_unit, 0.0
        self._goal, self._acknowledged = None, False

    def hold(self) -> None:
        """Hold the shaft where it is, without torque."""
        self._hold = self._measured[0]
        self._torque = 0.0

    def entered(self) -> None:
        """A change of state ends homing; without power nothing is commanded."""
        self._homing.stop()
        if not self.enabled:
            self._velocity = self._torque = 0.0

    def take_mode_bits(self, word: int) -> None:
        """Bit 4 starts a positioning or homing."""
        mode = self.values[0x6061, 0]
        if mode == 1:
            self._take_setpoint(word)
        elif mode == 6:
            self._take_homing(word)

    # -- profiles, in counts and per mille

    def _move_velocity(self, stopping: bool, elapsed_s: float) -> None:
        values = self.values
        quick = self.state is not PowerState.OPERATION_ENABLED
        down = values[0x6085 if quick else 0x6084, 0]
        limit = values[0x607F, 0]
        target = 0.0 if stopping else max(-limit, min(limit, values[0x60FF, 0]))
        self._velocity = ramp(self._velocity, target, max(values[0x6083, 0], 1), max(down, 1), elapsed_s)

    def _move_torque(self, elapsed_s: float) -> float:
        """Along the torque slope (6087h) to the target within max torque (6072h), in per mille."""
        limit, slope = self.values[0x6072, 0], float(max(self.values[0x6087, 0], 1))
        target = float(max(-limit, min(limit, self.values[0x6071, 0])))
        return ramp(self._torque, target, slope, slope, elapsed_s)

    def _take_setpoint(self, word: int) -> None:
        """Profile position handshake: new set-point (bit 4) is acknowledged until it falls (statusword bit 12)."""
        if not word & 0x10:
            self._acknowledged = False
        elif not self._acknowledged:
            self._acknowledged = True
            self._goal = float(self.values[0x607A, 0] - (self._offset or 0))

    def _take_homing(self, word: int) -> None:
        """Homing starts when bit 4 rises, and is interrupted when it falls."""
        if not word & 0x10:
            self._homing.stop()
            self._acknowledged = False
        elif not self._acknowledged:
            self._acknowledged = True
            self._homing.start(self.values[0x6098, 0])
            self._set_home()

    def _move_homing(self, elapsed_s: float) -> None:
        if not self._homing.running:
            return
        speeds = float(self.values[0x6099, 1]), float(self.values[0x6099, 2])
        measured = self._measured[0] * self._counts_per_unit
        self._position = self._homing.step(self._position, measured, *speeds, elapsed_s)
        self._set_home()

    def _set_home(self) -> None:
        """Once home is found: zero the counter where the shaft is."""
        if self._homing.phase == "done":
            self._offset = -round(self._measured[0] * self._counts_per_unit)

    def _move_position(self, elapsed_s: float) -> None:
        if self._goal is None:
            return
        values = self.values
        self._position, self._position_speed = approach(
            self._position,
            self._position_speed,
            self._goal,
            float(values[0x6081, 0]),
            float(max(values[0x6083, 0], 1)),
            elapsed_s,
        )

    def _statusword(self) -> int:
        word = self.state.value | _REMOTE | (0x10 if self.voltage_v > UNDERVOLTAGE_V else 0)
        mode = self.values[0x6061, 0]
        if mode == 1:
            word |= _BIT_12 if self._acknowledged else 0
            word |= _TARGET_REACHED if self._goal is not None and self._position == self._goal else 0
        elif mode == 6:
            word |= _BIT_12 if self._homing.phase == "done" else 0
            word |= _HOMING_ERROR if self._homing.phase == "error" else 0
            word |= 0 if self._homing.running else _TARGET_REACHED
        elif mode == 3:
            word |= _BIT_12 if self.values[0x606C, 0] == 0 else 0
            word |= _TARGET_REACHED if self._velocity == self.values[0x60FF, 0] else 0
        return word
