"""One retry with another exposure where the estimator finds the images badly exposed; back again if it does not help.

The wheels stand meanwhile: an image without the array is invalid, whatever the exposure. The other exposure stays for
as long as the array is seen with it; after one that did not help, the next is not before the array was seen again.
"""

from __future__ import annotations

from common.messages import StateCause
from common.timing import NS_PER_MS, HeldFor

FACTOR = 4.0
_PATIENCE_NS = 100 * NS_PER_MS
_LAPSE_NS = 50 * NS_PER_MS  # the dimmest of LEDs drown in noise now and then
_TRIAL_NS = 500 * NS_PER_MS


class ExposureRetry:
    """The exposure to use, from the estimator's verdict on the images."""

    def __init__(self, exposure_us: float, rate_hz: float) -> None:
        self._configured_us = self.exposure_us = exposure_us
        self._longest_us = max(0.8e6 / rate_hz, exposure_us)
        self._bad = HeldFor(_PATIENCE_NS)
        self._last_bad_ns = self._tried_ns = 0
        self._spent = False

    def judge(self, now_ns: int, cause: StateCause) -> float:
        """The exposure [µs] from now on, after a state of this cause."""
        if cause in ("overexposed", "underexposed"):
            self._last_bad_ns = now_ns
        lapsed = cause in ("ok", "confirming") or now_ns - self._last_bad_ns > _LAPSE_NS
        bad = cause in ("overexposed", "underexposed")
        lasting = self._bad.step(now_ns, bad or (self._bad.holding and not lapsed))
        if self.exposure_us != self._configured_us:
            if cause in ("ok", "confirming"):  # an array is in sight: its light code takes two seconds
                self._tried_ns, self._spent = now_ns, self._spent and cause != "ok"
            elif now_ns - self._tried_ns > _TRIAL_NS:
                self.exposure_us = self._configured_us
                self._bad.reset()
        elif cause == "ok":
            self._spent = False
        elif lasting and now_ns == self._last_bad_ns and not self._spent:
            longer = self._configured_us * (FACTOR if cause == "underexposed" else 1.0 / FACTOR)
            self.exposure_us, self._tried_ns, self._spent = min(longer, self._longest_us), now_ns, True
            self._bad.reset()
        return self.exposure_us
