"""The LED array: on whenever the Leader runs, currents by request, faults by measured current, thermal derating."""

from __future__ import annotations

from common.config import LeaderConfig, LedsConfig
from common.led_code import level
from common.messages import LedRequest
from common.timing import NS_PER_MS, NS_PER_S, HeldFor

_SETTLE_NS = NS_PER_S // 2
# a set-point crosses the bus, and the LED and its measurement follow, in two steps
_FOLLOWS_NS = 35 * NS_PER_MS


class LedDriver:
    """Steps with each measurement of the currents.

    Heat is estimated, not measured: each LED's follows the square of its current with the configured time constant.
    With a code the currents alternate between what was asked for and a share of it; measurements are compared, and
    reported, once they have followed the last change.

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
        self._code = leds.code
        self._level = 1.0
        self._changed_ns: int | None = None
        # of each level: whether each LED deviated when it was last measured there
        self._deviates: dict[float, list[bool]] = {}
        self._measured = (0.0,) * count, self.currents_a
        self._before_ns: int | None = None
        self.cause = ""
        self.fault = False

    @property
    def currents_a(self) -> tuple[float, ...]:
        """Current to set at each LED now [A]."""
        rated = self._config.led_rated_current_a
        return tuple(
            self._level * (min(asked, rated) if derated else asked)
            for asked, derated in zip(self._asked_a, self._derated, strict=True)
        )

    @property
    def measured(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Currents drawn and set [A], by LED, when the measurement last had followed the set-points."""
        return self._measured

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
        self._deviates.clear()
        return ""

    def step(self, now_ns: int, measured_a: tuple[float, ...]) -> None:
        """Take a measurement: current of each LED [A]; then the next symbol of the code, if it is due."""
        elapsed_s = 0.0 if self._before_ns is None else max(0.0, (now_ns - self._before_ns) / NS_PER_S)
        self._before_ns = now_ns
        self._warm(measured_a, min(1.0, elapsed_s / self._config.led_thermal_s))
        commanded = self.currents_a
        if self._changed_ns is None or now_ns - self._changed_ns >= _FOLLOWS_NS:
            self._measured = measured_a, commanded
            tolerance_a = self._config.led_current_tolerance_a
            self._deviates[self._level] = [
                abs(is_a - wanted_a) > tolerance_a for is_a, wanted_a in zip(measured_a, commanded, strict=True)
            ]
        self._judge(now_ns)
        self._next_symbol(now_ns)

    def _judge(self, now_ns: int) -> None:
        """A LED has a fault once it has deviated at either level for too long."""
        faulty = []
        for led, (is_a, wanted_a) in enumerate(zip(*self._measured, strict=True)):
            deviates = any(at_level[led] for at_level in self._deviates.values())
            if self._deviating[led].step(now_ns, deviates):
                faulty.append(f"LED {led} draws {is_a:.2f} A, commanded {wanted_a:.2f} A")
        off = [f"LED {led} is switched off" for led, asked_a in enumerate(self._asked_a) if asked_a == 0.0]
        self.fault = bool(faulty)
        self.cause = "; ".join(faulty + off)

    def _next_symbol(self, now_ns: int) -> None:
        if self._code is None:
            return
        due = level(self._code.number, self._code.symbol_ms * NS_PER_MS, self._code.depth, now_ns)
        if due != self._level:
            self._level, self._changed_ns = due, now_ns

    def _warm(self, measured_a: tuple[float, ...], share: float) -> None:
        rated = self._config.led_rated_current_a
        for led, current_a in enumerate(measured_a):
            self._heat[led] += share * ((current_a / rated) ** 2 - self._heat[led])
            above = self._asked_a[led] > rated
            self._derated[led] = above and (self._derated[led] or self._heat[led] >= 1.0)
