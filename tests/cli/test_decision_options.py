"""Options of what decides, the same in every verb that has them."""

from __future__ import annotations

import argparse
from pathlib import Path

import pytest

from graspcast.cli.decision_options import (
    add_models,
    add_robot_policy,
    add_threshold,
    watcher_of,
)
from graspcast.demo_data import demo_model
from graspcast.errors import UnknownNameError


def parsed(*arguments: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    for add in (add_models, add_threshold, add_robot_policy):
        add(parser)
    return parser.parse_args(arguments)


def test_models_are_files_and_demo_is_the_one_that_ships() -> None:
    options = parsed(
        "--model", "demo", "--model", "./demo", "--certificate", "a", "--certificate", "b"
    )
    assert options.model == [demo_model(), Path("demo")]
    assert options.certificate == [Path("a"), Path("b")]
    assert (options.threshold, options.guide, options.max_looks) == (None, None, 3)


@pytest.mark.parametrize("wrong", [("--threshold", "1.5"), ("--max-looks", "0")])
def test_what_is_out_of_range_is_refused(wrong: tuple[str, str]) -> None:
    with pytest.raises(SystemExit):
        parsed("--model", "demo", *wrong)


def test_the_watcher_decides_by_the_options() -> None:
    asked = "--model", "demo", "--threshold", "0.7", "--guide", "fused", "--max-looks", "2"
    with pytest.raises(UnknownNameError, match="unknown guide 'nobody'"):
        watcher_of(parsed("--model", "demo", "--guide", "nobody"), [])
    (policy,) = watcher_of(parsed(*asked), []).policies
    assert (policy["threshold"], policy["guide"], policy["max_looks"]) == (0.7, "fused", 2)
