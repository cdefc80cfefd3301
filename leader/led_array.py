"""The LED array: on whenever the Leader runs, currents by request, faults by measured current, thermal derating."""

from __future__ import annotations

from common.config import LeaderConfig, LedsConfig
from common.messages import LedRequest
from common.timing import NS_PER_S, HeldFor

_SETTLE_NS = NS_PER_S // 2


class LedDriver:
    """Steps with each measurement of the currents.

    Heat is estimated, not measured: each LED's follows the square of its current with the configured time constant.
    An LED that is asked for more than its rated current gets it until it is as hot as at rated current, and the rated
    current from then on.
    """

    def __init__(self, config: LeaderConfig, leds: LedsConfig) -> None:
        self._config = config
        self._nominal_a = leds.current_a
        count = len(leds.positions_m)
        self._asked_a = [leds.current_a] * count
        self._heat = [0.0] * count
        self._derated = [False] * count
        self._deviating = [HeldFor(_SETTLE_NS, strictly=True) for _ in range(count)]
        self._before_ns: int | None = None
        self.cause = ""
        self.fault = False

    @property
    def currents_a(self) -> tuple[float, ...]:
        """Current to set at each LED [A]."""
        rated = self._config.led_rated_current_a
        return tuple(
            min(asked, rated) if derated else asked
            for asked, derated in zip(self._asked_a, self._derated, strict=True)
        )

    @property
    def derated(self) -> bool:
        """Whether some LED gets less than was asked for."""
        return any(self._derated)

    @property
    def lit(self) -> bool:
        """Whether every LED is on and draws the current that was set."""
        return all(current > 0.0 for current in self.currents_a) and not any(
            deviating.holding for deviating in self._deviating
        )

    def ask(self, request: LedRequest) -> str:
        """Set currents as requested.

        Returns:
            The reason of a refusal; empty if the currents were set.
        """
        current_a = self._nominal_a if request.current_a is None else request.current_a
        if current_a > self._config.led_max_current_a:
            most_a = self._config.led_max_current_a
            return f"{current_a:.2f} A exceeds leader.led_max_current_a = {most_a:.2f} A"
        if request.led is not None and request.led >= len(self._asked_a):
            return f"no LED {request.led}: the array has LEDs 0 to {len(self._asked_a) - 1}"
        for led in range(len(self._asked_a)) if request.led is None else (request.led,):
            self._asked_a[led] = current_a
            self._deviating[led].reset()
        return ""

    def step(self, now_ns: int, measured_a: tuple[float, ...]) -> None:
        """Take a measurement: current of each LED [A]."""
        elapsed_s = 0.0 if self._before_ns is None else max(0.0, (now_ns - self._before_ns) / NS_PER_S)
        self._before_ns = now_ns
        self._warm(measured_a, min(1.0, elapsed_s / self._config.led_thermal_s))
        commanded = self.currents_a
        faulty = []
        for led, (is_a, wanted_a) in enumerate(zip(measured_a, commanded, strict=True)):
            deviates = abs(is_a - wanted_a) > self._config.led_current_tolerance_a
            if self._deviating[led].step(now_ns, deviates):
                faulty.append(f"LED {led} draws {is_a:.2f} A, commanded {wanted_a:.2f} A")
        off = [f"LED {led} is switched off" for led, wanted_a in enumerate(commanded) if wanted_a == 0.0]
        self.fault = bool(faulty)
        self.cause = "; ".join(faulty + off)

    def _warm(self, measured_a: tuple[float, ...], share: float) -> None:
        rated = self._config.led_rated_current_a
        for led, current_a in enumerate(measured_a):
            self._heat[led] += share * ((current_a / rated) ** 2 - self._heat[led])
            above = self._asked_a[led] > rated
            self._derated[led] = above and (self._derated[led] or self._heat[led] >= 1.0)
