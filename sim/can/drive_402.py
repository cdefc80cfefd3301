"""A simulated CiA 402 drive: state machine, profile velocity, torque and position, ramps, encoder, watchdog reaction.

It tells a plant what the motor is told and takes what the plant measured, both at the output shaft. Not modelled:
current control, commutation, temperature; the torque limit is left to the plant. With homing configured
the encoder is incremental: it counts from where the drive was switched on (:mod:`sim.can.drive_homing`).
"""

from __future__ import annotations

import math
from enum import Enum
from pathlib import Path
from typing import Literal

from common.config import DriveConfig
from sim.can.device import CanopenDevice
from sim.can.drive_homing import HomingRun
from sim.can.drive_profile import approach, ramp
from sim.can.faults import EncoderFault
from sim.can.pdo import Key


class PowerState(Enum):
    """CiA 402 power drive system states; the value is the statusword's coding."""

    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION_ACTIVE = 0x0F
    FAULT = 0x08


_POWERED = (PowerState.OPERATION_ENABLED, PowerState.QUICK_STOP_ACTIVE, PowerState.FAULT_REACTION_ACTIVE)
_STAYS_IN_QUICK_STOP = (5, 6, 7, 8)
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


class Drive402(CanopenDevice):
    """One drive. ``units_per_turn`` of the output shaft: 2π rad, or metres for a lead screw.

    Where names say rad, a drive with another unit per turn means its own unit.
    """

    def __init__(self, config: DriveConfig, eds: Path, units_per_turn: float = 2 * math.pi) -> None:
        super().__init__(config.node_id, eds, config.serial)
        self._counts_per_unit = config.counts_per_turn * config.gear_ratio * config.sign / units_per_turn
        # raw counts are the shaft's place plus this; unknown until an incremental encoder is switched on
        self._offset: int | None = None if config.homing else config.zero_counts
        switch = config.homing.position * self._counts_per_unit if config.homing else 0.0
        self._homing = HomingRun(switch)
        self._permille_per_n_m = 1000.0 * config.sign / (config.rated_torque_n_m * config.gear_ratio)
        self.values[0x6076, 0] = round(config.rated_torque_n_m * 1000)
        self.state = PowerState.SWITCH_ON_DISABLED
        self.voltage_v = 48.0
        self.encoder = EncoderFault()
        self._after_ramp: PowerState | None = None
        self._last_controlword = 0
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
    def enabled(self) -> bool:
        """Whether the power stage drives the motor."""
        return self.state in _POWERED

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
        """Speed that the drive wants of the output shaft, after its ramp."""
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
        """Position of the output shaft: on its way to the target, or held where it was stopped."""
        mode = self.values[0x6061, 0]
        held = self.state is not PowerState.OPERATION_ENABLED or mode not in _POSITION_MODES
        return self._hold if held else self._position / self._counts_per_unit

    def set_measured(self, position_rad: float, velocity_rad_s: float, torque_n_m: float) -> None:
        """What the plant's output shaft does; the encoder quantises it."""
        self._measured = (position_rad, velocity_rad_s, torque_n_m)

    # -- the device's side

    def moved(self, elapsed_s: float) -> None:
        """Advance the profile of the active mode, or the ramp of a stop."""
        if self.voltage_v < UNDERVOLTAGE_V and self.state not in (PowerState.FAULT_REACTION_ACTIVE, PowerState.FAULT):
            self.trip(UNDERVOLTAGE, 0x04)
        if not self.enabled or elapsed_s <= 0.0:
            return
        stopping = self.state is not PowerState.OPERATION_ENABLED or self._after_ramp is not None
        mode = self.values[0x6061, 0]
        if mode == 3:
            self._move_velocity(stopping, elapsed_s)
        elif mode == 4:
            self._torque = 0.0 if stopping else self._move_torque(elapsed_s)
        elif mode == 1 and not stopping:
            self._move_position(elapsed_s)
        elif mode == 6 and not stopping:
            self._move_homing(elapsed_s)
        if self._after_ramp is not None and (mode != 3 or self._velocity == 0.0):
            self._enter(self._after_ramp)

    def written(self, key: Key) -> None:
        """Act on controlword, mode and targets."""
        if key == (0x6040, 0):
            self._obey(self.values[key])
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

    def heartbeat_missed(self) -> None:
        """Abort connection option code (6007h): 1 fault, 2 disable voltage, 3 quick stop."""
        option = self.values[0x6007, 0]
        if option == 1:
            self.trip(0x8130)
        elif option == 2 and self.enabled:
            self._enter(PowerState.SWITCH_ON_DISABLED)
        elif option == 3 and self.state is PowerState.OPERATION_ENABLED:
            self._quick_stop()

    def stopped(self) -> None:
        """Out of NMT operational no set-point can come any more: quick stop."""
        if self.state is PowerState.OPERATION_ENABLED:
            self._quick_stop()

    def trip(self, code: int, register: int = 0x01) -> None:
        """A fault of the drive itself: EMCY, fault reaction, then fault until it is reset."""
        self.values[0x603F, 0] = code
        self.emergency(code, register)
        if self.enabled:
            self._stop_into(PowerState.FAULT_REACTION_ACTIVE, PowerState.FAULT)
        else:
            self._enter(PowerState.FAULT)

    # -- state machine

    def _obey(self, word: int) -> None:
        """CiA 402 table "command coding"; a command that the state does not know is ignored."""
        rising_reset = word & 0x80 and not self._last_controlword & 0x80
        self._last_controlword = word
        if rising_reset and self.state is PowerState.FAULT:
            self.values[0x603F, 0] = 0
            self.emergency(0x0000, 0x00)
            self._enter(PowerState.SWITCH_ON_DISABLED)
        elif word & 0x02 == 0:
            self._disable_voltage()
        elif word & 0x04 == 0:
            self._command_quick_stop()
        elif word & 0x01 == 0:
            self._shutdown()
        elif word & 0x08 == 0:
            self._switch_on()
        else:
            self._enable_operation(word)

    def _disable_voltage(self) -> None:
        if self.state not in (PowerState.FAULT, PowerState.FAULT_REACTION_ACTIVE):
            self._enter(PowerState.SWITCH_ON_DISABLED)

    def _command_quick_stop(self) -> None:
        if self.state in (PowerState.READY_TO_SWITCH_ON, PowerState.SWITCHED_ON):
            self._enter(PowerState.SWITCH_ON_DISABLED)
        elif self.state is PowerState.OPERATION_ENABLED:
            self._quick_stop()

    def _shutdown(self) -> None:
        if self.state in (PowerState.SWITCH_ON_DISABLED, PowerState.SWITCHED_ON, PowerState.OPERATION_ENABLED):
            self._enter(PowerState.READY_TO_SWITCH_ON)

    def _switch_on(self) -> None:
        if self.state is PowerState.READY_TO_SWITCH_ON:
            self._enter(PowerState.SWITCHED_ON)
        elif self.state is PowerState.OPERATION_ENABLED and self._after_ramp is None:
            ramped = self.values[0x605C, 0] == 1
            self._after_ramp = PowerState.SWITCHED_ON
            if not ramped or self.values[0x6061, 0] != 3 or self._velocity == 0.0:
                self._enter(PowerState.SWITCHED_ON)

    def _enable_operation(self, word: int) -> None:
        if self.state is PowerState.READY_TO_SWITCH_ON:
            self._enter(PowerState.SWITCHED_ON)
        resumable = self.state is PowerState.QUICK_STOP_ACTIVE and self.values[0x605A, 0] in _STAYS_IN_QUICK_STOP
        if resumable or self.state is PowerState.SWITCHED_ON:
            self._start()
        elif self.state is PowerState.OPERATION_ENABLED:
            self._after_ramp = None
        if self.state is PowerState.OPERATION_ENABLED and self.values[0x6061, 0] == 1:
            self._take_setpoint(word)
        elif self.state is PowerState.OPERATION_ENABLED and self.values[0x6061, 0] == 6:
            self._take_homing(word)

    def _start(self) -> None:
        """Into operation enabled: every profile begins where the shaft is."""
        position, velocity, _ = self._measured
        self._velocity = velocity * self._counts_per_unit
        self._torque = 0.0
        self._position, self._position_speed = position * self._counts_per_unit, 0.0
        self._goal, self._acknowledged = None, False
        self._enter(PowerState.OPERATION_ENABLED)

    def _quick_stop(self) -> None:
        stays = self.values[0x605A, 0] in _STAYS_IN_QUICK_STOP
        self._stop_into(PowerState.QUICK_STOP_ACTIVE, None if stays else PowerState.SWITCH_ON_DISABLED)

    def _stop_into(self, state: PowerState, after: PowerState | None) -> None:
        self._enter(state)
        self._after_ramp = after
        self._hold = self._measured[0]
        self._torque = 0.0

    def _enter(self, state: PowerState) -> None:
        self.state = state
        self._after_ramp = None
        self._homing.stop()
        if not self.enabled:
            self._velocity = self._torque = 0.0

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
        """Home found: the counter is zero where the shaft is."""
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
