"""The evaluation with several views from fusing to Markdown."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from graspcast.evaluation.bootstrap import Bootstrap
from graspcast.evaluation.view_fusion import fuse_benchmark
from graspcast.evaluation.view_report import evaluate_views, rows_of
from graspcast.evaluation.view_sets import ViewModelRule, ViewRow, view_rows
from graspcast.evaluation.view_tables import render_views
from viewed import SMALL, benchmark

ROWS = [ViewRow("2 views", 2), ViewRow("3 views", 3), ViewRow("b", 3, ViewModelRule(alone="b"))]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    whole, sources = benchmark(tmp_path_factory.mktemp("models"))
    views = fuse_benchmark(sources, whole.estimates, ROWS)
    return evaluate_views(
        replace(whole, views=views),
        ["several_views", "several_views_unseen_object"],
        ROWS[:2],
        settings=SMALL,
        bootstrap=Bootstrap(draws=20),
    )


def test_unseen_objects_are_forecast_by_one_model() -> None:
    rows = view_rows(["a", "b"])
    assert rows_of(["several_views"], rows) == rows
    some = rows_of(["several_views_unseen_object"], rows)
    assert [row.name for row in some] == ["2 views", "3 views", "5 views"]


@pytest.mark.slow
def test_differences_are_those_of_the_scores(found: dict[str, Any]) -> None:
    mine = found["several_views"]["scores"]["3 views"]["p"]
    views, single = mine["views"], mine["one view"]
    difference = views["differences"]["one view"]["auroc"]
    assert difference["difference"] == pytest.approx(views["auroc"] - single["auroc"])
    assert difference["interval"][0] > 0


@pytest.mark.slow
def test_it_is_plain_json_and_markdown(found: dict[str, Any]) -> None:
    json.dumps(found, allow_nan=False)
    text = render_views(found)
    for words in ("3 views: the same from one view", "look again, up to 3", "| p, best, 3 views"):
        assert words in text
    assert text.count("### `several_views") == 2
    assert "nan" not in text
