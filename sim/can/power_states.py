"""The power drive system of a simulated CiA 402 drive: its states, the controlword's commands, its stop reactions."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from sim.can.device import CanopenDevice


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


class PowerDrive(CanopenDevice):
    """The state machine of one drive. Subclasses fill in the motion."""

    def __init__(self, node_id: int, eds: Path, serial: int) -> None:
        super().__init__(node_id, eds, serial)
        self.state = PowerState.SWITCH_ON_DISABLED
        self._after_ramp: PowerState | None = None
        self._last_controlword = 0

    @property
    def enabled(self) -> bool:
        """Whether the power stage drives the motor."""
        return self.state in _POWERED

    @property
    def stopping(self) -> bool:
        """Whether a stop overrides the set-points."""
        return self.state is not PowerState.OPERATION_ENABLED or self._after_ramp is not None

    def trip(self, code: int, register: int = 0x01) -> None:
        """A fault of the drive itself: EMCY, fault reaction, then fault until it is reset."""
        self.values[0x603F, 0] = code
        self.emergency(code, register)
        if self.enabled:
            self._stop_into(PowerState.FAULT_REACTION_ACTIVE, PowerState.FAULT)
        else:
            self._enter(PowerState.FAULT)

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

    def obey(self, word: int) -> None:
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

    def finish_stop(self) -> None:
        """Enter the state that follows a stop, once its ramp has ended."""
        if self._after_ramp is not None and not self.ramping:
            self._enter(self._after_ramp)

    # -- what subclasses fill in

    @property
    def ramping(self) -> bool:
        """Whether the velocity set-point is still on its ramp to zero; other modes have none."""
        return False

    def begin(self) -> None:
        """About to enter operation enabled: every profile begins where the shaft is."""

    def hold(self) -> None:
        """A stop has begun: hold the position of this moment."""

    def entered(self) -> None:
        """The drive is in a new state."""

    def take_mode_bits(self, word: int) -> None:
        """A controlword came in operation enabled: act on the bits that belong to the mode."""

    # -- commands and transitions

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
            slows_down = self.values[0x605C, 0] == 1
            self._after_ramp = PowerState.SWITCHED_ON
            if not slows_down or not self.ramping:
                self._enter(PowerState.SWITCHED_ON)

    def _enable_operation(self, word: int) -> None:
        if self.state is PowerState.READY_TO_SWITCH_ON:
            self._enter(PowerState.SWITCHED_ON)
        resumable = self.state is PowerState.QUICK_STOP_ACTIVE and self.values[0x605A, 0] in _STAYS_IN_QUICK_STOP
        if resumable or self.state is PowerState.SWITCHED_ON:
            self.begin()
            self._enter(PowerState.OPERATION_ENABLED)
        elif self.state is PowerState.OPERATION_ENABLED:
            self._after_ramp = None
        if self.state is PowerState.OPERATION_ENABLED:
            self.take_mode_bits(word)

    def _quick_stop(self) -> None:
        stays = self.values[0x605A, 0] in _STAYS_IN_QUICK_STOP
        self._stop_into(PowerState.QUICK_STOP_ACTIVE, None if stays else PowerState.SWITCH_ON_DISABLED)

    def _stop_into(self, state: PowerState, after: PowerState | None) -> None:
        self._enter(state)
        self._after_ramp = after
        self.hold()

    def _enter(self, state: PowerState) -> None:
        self.state = state
        self._after_ramp = None
        self.entered()
