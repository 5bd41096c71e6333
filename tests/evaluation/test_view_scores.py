"""Scores of rows, paired with one view on the same instances."""

from __future__ import annotations

import polars as pl
import pytest

from graspcast.evaluation.bootstrap import Bootstrap
from graspcast.evaluation.view_scores import score_views


def table() -> pl.DataFrame:
    rows = []
    for i in range(24):
        for principal in ("a", "b"):
            good = i % 3 > 0
            single = 0.8 if i % 2 else 0.3
            entry = {"principal": principal, "gripper": "p", "instance": i, "object": "d-1"}
            entry |= {"scene": str(i // 6), "success": good, "one_view": single}
            rows.append({**entry, "row": "3 views", "probability": 0.9 if good else 0.1})
            if i < 12:
                rows.append({**entry, "row": "bin", "probability": single})
    rows.append({**rows[0], "principal": "fused", "success": None})
    return pl.DataFrame(rows)


def test_each_row_is_compared_on_its_own_instances() -> None:
    found = score_views(table(), bootstrap=Bootstrap(draws=50))
    assert list(found) == ["3 views", "bin"]
    whole, part = found["3 views"]["p"], found["bin"]["p"]
    assert (whole["n"], part["n"]) == (24, 12)
    assert whole["views"]["auroc"] == 1
    assert whole["views"]["differences"]["one view"]["auroc"]["interval"][0] > 0
    same = part["views"]["differences"]["one view"]["brier"]
    assert same["difference"] == 0 and same["interval"] == pytest.approx([0, 0])
    assert set(whole["views"]["by_principal"]) == {"a", "b"}
