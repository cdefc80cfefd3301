"""A simulated CiA 401 I/O module: the world sets its digital and analogue inputs and reads its outputs.

Not modelled: filters, polarity, interrupts, the analogue error values (6444h).
"""

from __future__ import annotations

from sim.can.device import CanopenDevice


class IoModule401(CanopenDevice):
    """Channels count from 1 as in the profile; digital bits from 0. Everything is in counts as on the wire."""

    def set_digital_input(self, bit: int, on: bool) -> None:
        """Input ``bit`` of 6000h:01."""
        mask = 1 << bit
        self.values[0x6000, 1] = self.values[0x6000, 1] | mask if on else self.values[0x6000, 1] & ~mask

    def set_analogue_input(self, channel: int, counts: int) -> None:
        """Input ``channel`` of 6401h."""
        self.values[0x6401, channel] = max(-32768, min(32767, counts))

    def digital_output(self, bit: int) -> bool:
        """Output ``bit`` of 6200h:01 at the terminal."""
        return bool(self.values[0x6200, 1] >> bit & 1)

    def analogue_output(self, channel: int) -> int:
        """Output ``channel`` of 6411h at the terminal."""
        return self.values[0x6411, channel]

    def heartbeat_missed(self) -> None:
        """Error mode: outputs chosen in 6206h take the value in 6207h; analogue outputs with 6443h = 1 go to 0."""
        self._error_values()

    def stopped(self) -> None:
        """Leaving NMT operational counts as an error too (CiA 401)."""
        self._error_values()

    def _error_values(self) -> None:
        chosen, value = self.values[0x6206, 1], self.values[0x6207, 1]
        self.values[0x6200, 1] = self.values[0x6200, 1] & ~chosen | value & chosen
        for channel in range(1, 5):
            if self.values[0x6443, channel]:
                self.values[0x6411, channel] = 0
