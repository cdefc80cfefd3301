"""An interrupted experiment that keeps its work says so in one line."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
import typer

from station.interrupts import EXIT_INTERRUPTED, interruptible, resumable


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_an_interrupt_of_a_resumable_experiment_is_one_line(
    number: signal.Signals, capsys: pytest.CaptureFixture[str]
) -> None:
    before = signal.getsignal(number)
    with pytest.raises(typer.Exit) as ended, resumable(Path("out/soak")):
        os.kill(os.getpid(), number)
    assert ended.value.exit_code == EXIT_INTERRUPTED
    assert capsys.readouterr().err == "davpc: interrupted; the same command goes on from what is done in out/soak\n"
    assert signal.getsignal(number) is before


def test_an_interrupt_sets_a_flag() -> None:
    with interruptible() as interrupted:
        assert not interrupted()
        os.kill(os.getpid(), signal.SIGTERM)
        assert interrupted()
