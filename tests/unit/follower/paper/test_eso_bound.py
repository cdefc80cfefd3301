"""The observer's error bound: never too small, for any stable gains, and no larger than some disturbance reaches."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from common.geometry import Array
from follower.paper.eso_bound import error_bound

RINGING = [(0.4, 1.0), (0.2, 1.0), (0.1, 1.0)]
gains = st.floats(-1.0, 2.0).map(lambda exponent: float(10.0**exponent))


def system_of(l1: Array, l2: Array) -> Array:
    size = len(l1)
    return np.block([[-l1, np.eye(size)], [-l2, np.zeros((size, size))]])


def responses(l1: Array, l2: Array, steps: int = 20_000) -> tuple[Array, float]:
    """e^{At} D over the time in which it decays, (steps + 1, 2m, m), by eigenvalues; the step [s]."""
    l2 = l2 * (1 + 1e-9)  # apart from a double eigenvalue, of which there is no basis
    values, vectors = np.linalg.eig(system_of(l1, l2))
    step_s = 15.0 / -values.real.max() / steps
    decays = np.exp(np.outer(np.arange(steps + 1) * step_s, values))
    into = np.linalg.inv(vectors)[:, len(l1) :]
    return np.real(np.einsum("ij,tj,jk->tik", vectors, decays, into)), step_s


def papers_bound(l1: float, l2: float) -> float:
    """κ + σ of eq. (26)."""
    first, second = np.array([[l1]]), np.array([[l2]])
    inverse = np.linalg.inv(system_of(first, second))
    kappa = np.abs(inverse @ responses(first, second)[0]).max()
    return float(kappa + np.abs(inverse @ [0.0, 1.0]).max())


@pytest.mark.parametrize("gains_of_one", [(2.0, 1.0), (4.0, 4.0), (1.0, 1.0), (100.0, 1.0), (0.1, 100.0), *RINGING])
def test_no_disturbance_exceeds_the_bound_and_one_reaches_it(gains_of_one: tuple[float, float]) -> None:
    l1, l2 = (np.array([[gain]]) for gain in gains_of_one)
    response, step_s = responses(l1, l2)
    reached = np.trapezoid(np.abs(response[:, :, 0]), dx=step_s, axis=0)  # by h(t − τ) with the response's sign at τ
    reach = error_bound(*gains_of_one).reach
    assert np.all(reach >= reached * (1 - 1e-4))
    assert np.all(reach <= reached * 1.02)


@pytest.mark.parametrize("gains_of_one", RINGING)
def test_the_papers_bound_fails_for_an_observer_that_rings(gains_of_one: tuple[float, float]) -> None:
    l1, l2 = (np.array([[gain]]) for gain in gains_of_one)
    response, step_s = responses(l1, l2)
    reached = np.trapezoid(np.abs(response[:, :, 0]), dx=step_s, axis=0)
    assert reached.max() > 1.2 * papers_bound(*gains_of_one)


def test_the_papers_bound_is_kept_without_ringing() -> None:
    assert error_bound(2.0, 1.0).reach.max() <= 1.05 * papers_bound(2.0, 1.0)


@settings(max_examples=40, deadline=None)
@given(gains, gains, st.integers(0, 10_000))
def test_simulated_errors_keep_the_bound_for_random_gains(l1: float, l2: float, seed: int) -> None:
    system = system_of(np.array([[l1]]), np.array([[l2]]))
    bound = error_bound(l1, l2)
    values, vectors = np.linalg.eig(system)
    assume(np.linalg.cond(vectors) < 1e6)
    random = np.random.default_rng(seed)
    step_s = 0.2 / np.abs(values).max()
    transition = np.real(vectors @ np.diag(np.exp(values * step_s)) @ np.linalg.inv(vectors))
    forced = np.linalg.solve(system, (transition - np.eye(2)) @ [0.0, 1.0])
    error = random.normal(size=2)
    initial = float(np.abs(error).sum())
    rate = 1.0
    for _ in range(2000):
        if random.random() < 0.05:
            rate = random.uniform(-1.0, 1.0) if random.random() < 0.5 else -np.sign(rate)
        error = transition @ error + forced * rate
        assert np.all(np.abs(error) <= bound.at(initial, 1.0) * (1 + 1e-9))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 100_000))
def test_full_gain_matrices_keep_the_bound(seed: int) -> None:
    random = np.random.default_rng(seed)
    l1 = np.diag(random.uniform(0.3, 3.0, 3)) + 0.3 * random.normal(size=(3, 3))
    l2 = np.diag(random.uniform(0.3, 3.0, 3)) + 0.3 * random.normal(size=(3, 3))
    values, vectors = np.linalg.eig(system_of(l1, l2))
    assume(values.real.max() < -0.02)
    assume(np.linalg.cond(vectors) < 1e4)
    response, step_s = responses(l1, l2)
    reached = np.trapezoid(np.abs(response).sum(axis=2), dx=step_s, axis=0)
    reach = error_bound(l1, l2).reach
    assert np.all(reach >= reached * (1 - 1e-4))
    assert np.all(reach <= reached * 1.03)


def test_higher_bandwidth_lowers_the_bound() -> None:
    reaches = [error_bound(2 * w, w * w).reach for w in (1.0, 2.0, 4.0)]
    assert np.all(reaches[1] < reaches[0])
    assert np.all(reaches[2] < reaches[1])


@pytest.mark.parametrize("unstable", [(0.0, 1.0), (1.0, -0.1), (-1.0, 1.0), (float("nan"), 1.0), (1.0, 0.0)])
def test_gains_without_a_bound_are_refused(unstable: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match="Hurwitz"):
        error_bound(*unstable)
