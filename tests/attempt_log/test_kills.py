"""Writers killed at random moments; benchmarks/log_kills.py does it a thousand times."""

import sys
from pathlib import Path

import pytest

_BENCHMARKS = str(Path(__file__).parents[2] / "benchmarks")


@pytest.fixture
def run(monkeypatch):
    monkeypatch.setattr(sys, "path", [_BENCHMARKS, *sys.path])
    from log_kills import run

    return run


@pytest.mark.parametrize("kills", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_nothing_is_lost_doubled_or_cut_by_kills(run, tmp_path, kills):
    found = run(tmp_path / "log.db", kills, 0.05, seed=1)
    assert found["acknowledged"] > 0
    for fault in ("damaged", "lost", "doubled", "cut", "disordered"):
        assert found[fault] == 0, found
