"""How the command line answers what it cannot do."""

from __future__ import annotations

import pytest

from graspcast.cli import main


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Standard error: one message after any notes; exit code 2 and nothing on standard output."""
    capsys.readouterr()
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    lines = err.strip().splitlines()
    said = [number for number, line in enumerate(lines) if line.startswith("graspcast ")]
    assert said == [len(lines) - 1], err
    return err
