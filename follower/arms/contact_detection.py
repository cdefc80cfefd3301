"""Contact and rigid connection by the force along the handle: the paper's torque variation."""

from __future__ import annotations

from common.config import ArmsConfig
from common.timing import NS_PER_MS, HeldFor
from follower.arms.sampling import SampleInterval, step_held

_RELEASE_SHARE = 0.5
_CONTACT_HOLD_NS = 150 * NS_PER_MS
_CONNECTED_HOLD_NS = 50 * NS_PER_MS
_FORCE_FILTER_S = 0.04
_RESISTANCE_FILTER_S = 1.0


class ContactDetector:
    """Contact is a lasting change of the handle's force, connection a greater force.

    The change counts from the resistance that was learned while the trolley rolled; the force that accelerates a
    trolley of ``inertia_allowance_kg`` is allowed for. By torque alone, slowly climbing the edge of a rubber pad
    feels like the guide: the paper adds the visual error, so contact is reported only where it is expected. Once on,
    both stay on until the force falls below half the threshold. ``force_n`` and ``resistance_n`` are along the
    chassis.
    """

    def __init__(self, config: ArmsConfig) -> None:
        self._config = config
        self._contact = HeldFor(_CONTACT_HOLD_NS)
        self._connected = HeldFor(_CONNECTED_HOLD_NS)
        self.force_n = 0.0
        self.resistance_n = 0.0

    @property
    def contact(self) -> bool:
        """Whether something ahead resists."""
        return self._contact.on

    @property
    def connected(self) -> bool:
        """Whether it resists rigidly."""
        return self._connected.on

    def step(
        self,
        force_n: float,
        acceleration_m_s2: float,
        interval: SampleInterval,
        *,
        rolling: bool = False,
        expected: bool = False,
    ) -> None:
        """Take one sample.

        Args:
            force_n: on the handle along x of {F} [N], unfiltered.
            acceleration_m_s2: of the base.
            interval: from the sample before to this one.
            rolling: driving ahead with nothing to be met, so that resistance may be learned.
            expected: the visual error has settled at the goal, and the trolley is pushed on.
        """
        config, dt_s = self._config, interval.dt_s
        self.force_n += min(1.0, dt_s / _FORCE_FILTER_S) * (force_n - self.force_n)
        allowed_n = config.contact_force_n + config.inertia_allowance_kg * abs(acceleration_m_s2)
        _step_threshold(self._contact, self.force_n - self.resistance_n if expected else 0.0, allowed_n, interval)
        _step_threshold(self._connected, self.force_n, config.connected_force_n, interval)
        if rolling and not expected:
            learned = self.resistance_n + min(1.0, dt_s / _RESISTANCE_FILTER_S) * (self.force_n - self.resistance_n)
            self.resistance_n = min(config.pushing_force_n, max(0.0, learned))


def _step_threshold(held: HeldFor, force_n: float, threshold_n: float, interval: SampleInterval) -> None:
    step_held(held, interval, force_n > threshold_n, stays=force_n >= _RELEASE_SHARE * threshold_n)
