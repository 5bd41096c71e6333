"""The word ``built-in`` in place of results files."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from graspcast.cli.built_in_estimates import named_or_built_in, with_built_in
from graspcast.demo_data import demo_dataset
from graspcast.simulation.campaign import shipped_estimates


def options(*estimates: str, ground_truth: list[Path] | None = None) -> argparse.Namespace:
    return argparse.Namespace(
        estimates=[named_or_built_in(text) for text in estimates],
        bop=[("mine", Path("mine"))],
        ground_truth=ground_truth or [],
    )


@pytest.fixture(autouse=True)
def cached(monkeypatch: pytest.MonkeyPatch) -> None:
    """Estimates as if they were computed already."""
    files = {name: Path(f"{name}_ycbv-test.csv") for name in ("dense", "direct")}
    monkeypatch.setattr(shipped_estimates, "shipped_estimates", lambda **_: files)


def test_it_stands_for_the_estimators_and_their_tables(capsys: pytest.CaptureFixture[str]) -> None:
    found = with_built_in(options("mine=mine.csv", "built-in"))
    assert [name for name, _ in found.estimates] == ["mine", "dense", "direct"]
    assert found.bop == [("mine", Path("mine")), ("ycbv", demo_dataset().root)]
    assert found.ground_truth == []
    assert "dense, direct on the 300 shipped images" in capsys.readouterr().err
    with_truth = with_built_in(options("built-in", ground_truth=[Path("gt")]))
    assert len(with_truth.ground_truth) == len(with_truth.bop) == 2


def test_other_estimates_stay_as_they_are() -> None:
    found = with_built_in(options("a=a.csv"))
    assert found.estimates == [("a", Path("a.csv"))]
    assert found.bop == [("mine", Path("mine"))]


@pytest.mark.parametrize("text", ["builtin", "a=", "=b.csv"])
def test_what_is_neither_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="NAME=FILE"):
        named_or_built_in(text)
