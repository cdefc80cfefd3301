"""What all tests share: the reference robots, a settled Hypothesis profile, a closing table of skips."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from common.config import Config, load_config
from tests.rigs.canbus_rig import CONFIG_PATH
from tests.rigs.sim_run import SimRuns

settings.register_profile("davpc", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("davpc")


@pytest.fixture(scope="session")
def config() -> Config:
    """The reference robots."""
    return load_config(CONFIG_PATH)


@pytest.fixture(scope="session")
def config_path() -> Path:
    """Where the reference robots are written down."""
    return CONFIG_PATH


@pytest.fixture
def sim_run(tmp_path: Path) -> Iterator[SimRuns]:
    """Starts runs and leaves none behind."""
    runs = SimRuns(tmp_path)
    yield runs
    runs.stop()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Note with a skip which test has asserted the same in stepped time."""
    report = yield
    twin = item.get_closest_marker("stepped_twin")
    if report.skipped and twin is not None:
        said = twin.args[0] if twin.args else f"no stepped twin: {twin.kwargs['none']}"
        report.user_properties.append(("stepped_twin", said))
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """One table of what was skipped and why, before the closing line."""
    skipped = terminalreporter.getreports("skipped")
    if not skipped:
        return
    terminalreporter.section(f"{len(skipped)} skipped: test, why, stepped twin")
    for report in skipped:
        why = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        twin = dict(report.user_properties).get("stepped_twin", "–") if hasattr(report, "user_properties") else "–"
        terminalreporter.line(f"{report.nodeid} | {why.removeprefix('Skipped: ')} | {twin}")
