"""Whether an array that is followed carries our Leader's code: its brightness over time against the code.

There is no common clock: the code is compared at every phase. What the brightness does slowly, as the robot drives,
is removed from both by a quadratic in time. The correlation does not depend on how deep the modulation appears, so
saturation does not matter as long as some of it is left.
"""

from __future__ import annotations

from collections import deque
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from common.config import LedCodeConfig
from common.geometry import Array
from common.led_code import SYMBOLS, symbols_of
from common.timing import NS_PER_MS, NS_PER_S

Indices = NDArray[np.int64]
CodeVerdict = Literal["unknown", "own", "other"]

# correlations: another code of the site reaches .31 at most, noise .4 in a million windows, our own .9 and more
OWN, OWN_EACH, OTHER, LOST = 0.8, 0.5, 0.5, 0.4
_BIN_NS = 10 * NS_PER_MS
_COVERED = 0.6
_FEWEST_LEDS = 3
_JUDGED_EVERY = 6


class CodeReceiver:
    """Takes the spots' masses of one array, frame by frame.

    Args:
        code: of the pair.
        rate_hz: of the camera.
    """

    def __init__(self, code: LedCodeConfig, rate_hz: float) -> None:
        symbol_ns = code.symbol_ms * NS_PER_MS
        self._bins = SYMBOLS * symbol_ns // _BIN_NS
        self._period_ns = self._bins * _BIN_NS
        self._fewest = _COVERED * rate_hz * self._period_ns / NS_PER_S
        at = (np.arange(self._bins) * _BIN_NS + _BIN_NS // 2) // symbol_ns
        wave = np.where(symbols_of(code.number)[at], 1.0, -1.0)
        # a LED and its driver take some milliseconds from one level to the other
        self._wave = (np.roll(wave, 1) + wave) / 2.0
        self._spectrum, self._spectrum_of_square = np.fft.rfft(self._wave), np.fft.rfft(self._wave**2)
        self._samples: deque[tuple[int, Array]] = deque()
        self._since_judged = 0
        self.verdict: CodeVerdict = "unknown"
        self.correlation = 0.0

    def restart(self) -> None:
        """Forget what was received, not the verdict: the same array is seen again after a gap."""
        self._samples.clear()

    def take(self, capture_ns: int, mass: Array) -> CodeVerdict:
        """The verdict with one frame more.

        Args:
            capture_ns: middle of its exposure.
            mass: (n,) spot masses by LED, NaN where not seen.
        """
        if self._samples and not 0 < capture_ns - self._samples[-1][0] < self._period_ns:
            self._samples.clear()
        self._samples.append((capture_ns, np.log(mass)))
        while capture_ns - self._samples[0][0] >= self._period_ns:
            self._samples.popleft()
        self._since_judged += 1
        whole = capture_ns - self._samples[0][0] >= self._period_ns - self._period_ns // SYMBOLS
        enough = whole and len(self._samples) >= self._fewest
        if enough and self._since_judged >= _JUDGED_EVERY:
            self._since_judged = 0
            self._judge()
        return self.verdict

    def _judge(self) -> None:
        masses = np.array([mass for _, mass in self._samples])
        covered = np.isfinite(masses).sum(axis=0) >= self._fewest
        if np.count_nonzero(covered) < _FEWEST_LEDS:
            return
        masses = masses[:, covered]
        lit = np.isfinite(masses).any(axis=1)
        times = np.array([time_ns for time_ns, _ in self._samples])[lit]
        together, each = self._correlations(times, masses[lit])
        self.correlation = together
        if together >= OWN and each.min() >= OWN_EACH:
            self.verdict = "own"
        elif together < (LOST if self.verdict == "own" else OTHER):
            self.verdict = "other"

    def _correlations(self, times: Indices, masses: Array) -> tuple[float, Array]:
        """At the likeliest phase: of all LEDs together, and of each, (n,)."""
        since = (times - times[0]) / self._period_ns
        slow, _ = np.linalg.qr(np.stack([np.ones_like(since), since, since**2], axis=1))
        seen = np.isfinite(masses)
        centred = np.where(seen, masses, 0.0)
        counts = seen.sum(axis=0)
        centred = np.where(seen, centred - centred.sum(axis=0) / counts, 0.0)
        each = centred - slow @ (slow.T @ centred)
        mean = centred.sum(axis=1) / seen.sum(axis=1)
        mean -= slow @ (slow.T @ mean)
        bins = (times - times[0]) // _BIN_NS
        # per phase: the code on the samples, on the slow change, and its length without that
        on_mean, *on_slow = self._at_all_phases(bins, np.column_stack([mean, slow]), self._spectrum)
        (square,) = self._at_all_phases(bins, np.ones((len(times), 1)), self._spectrum_of_square)
        length = np.sqrt(np.maximum(square - np.square(on_slow).sum(axis=0), 1e-12))
        correlations = on_mean / (length * max(float(np.linalg.norm(mean)), 1e-12))
        best = int(np.argmax(correlations))
        wave = self._wave[(bins + best) % self._bins]
        wave = wave - slow @ (slow.T @ wave)
        lengths = np.maximum(np.linalg.norm(each, axis=0), 1e-12) * np.linalg.norm(wave)
        return float(correlations[best]), wave @ each / lengths

    def _at_all_phases(self, bins: Indices, values: Array, spectrum: NDArray[np.complex128]) -> Array:
        """Σ wave(bin + phase) · value over the samples, (columns, phases), by a circular correlation."""
        binned = np.zeros((self._bins, values.shape[1]))
        np.add.at(binned, bins, values)
        sums: Array = np.fft.irfft(np.conj(np.fft.rfft(binned.T)) * spectrum, self._bins)
        return sums
