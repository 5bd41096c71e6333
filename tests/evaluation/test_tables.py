"""The evaluation as Markdown: every protocol has its tables, with the numbers of the JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspcast.evaluation.bootstrap import Bootstrap
from graspcast.evaluation.predictions import Forecasts
from graspcast.evaluation.report import evaluate
from graspcast.evaluation.tables import render_evaluation


def forecasts(protocol: str, method: str) -> Forecasts:
    rng = np.random.default_rng(0)
    chance = rng.random(60)
    success = rng.random(60) < chance
    probability = chance if method == "good" else np.round(chance)
    scenes = np.array([f"d/{i // 10}" for i in range(60)])
    return Forecasts(
        protocol, method, "a", "parallel", probability, success, np.full(60, "d-1"), scenes
    )


def test_every_protocol_has_scores_differences_and_net_benefit() -> None:
    meanings = {"random_split": "What it is.", "unseen_scenes": "What that is."}
    methods = ("threshold", "good")
    found: dict[str, Any] = evaluate(
        [forecasts(p, m) for p in meanings for m in methods], bootstrap=Bootstrap(draws=40)
    )
    text = render_evaluation(
        {
            **found,
            "protocols": meanings,
            "methods": {m: f"How {m} works." for m in methods},
            "costs": {"failure": 2.0, "abstention": 0.2, "break_even": 0.6},
            "bootstrap": {"draws": 40, "confidence": 0.95},
        }
    )
    assert "from a probability of 0.600 on" in text
    for protocol, meaning in meanings.items():
        part = text[text.index(f"## `{protocol}`") :].partition("\n## ")[0]
        assert part.split("\n\n")[1] == meaning
        scores = found["evaluate"][protocol]["good"]["parallel"]
        rows = [line.replace(" ", "") for line in part.splitlines()]
        assert len([row for row in rows if row.startswith("|good|")]) == 2
        for name in ("auroc", "net_benefit"):
            low, high = scores[f"{name}_interval"]
            cell = f"{scores[name]:.3f}[{low:.3f},{high:.3f}]"
            assert any(row.startswith("|good|") and cell in row for row in rows)
        gap = scores["differences"]["threshold"]["brier"]
        (row,) = (row for row in rows if row.startswith("|goodminusthreshold|"))
        assert f"{gap['difference']:+.3f}[" in row
        for name, value in found["reference_net_benefit"][protocol]["parallel"].items():
            assert any(row.endswith(f"|{value:.3f}|") for row in rows), name


def test_undefined_scores_are_a_dash() -> None:
    every = forecasts("unseen_scenes", "good")
    sure = Forecasts(**{**vars(every), "success": np.ones(60, dtype=bool)})
    found = evaluate([sure], bootstrap=Bootstrap(draws=20))
    text = render_evaluation(
        {
            **found,
            "protocols": {"unseen_scenes": "Text."},
            "methods": {"good": "Text."},
            "costs": {"failure": 2.0, "abstention": 0.2, "break_even": 0.6},
            "bootstrap": {"draws": 20, "confidence": 0.95},
        }
    )
    (row, _) = (line for line in text.splitlines() if line.startswith("| good"))
    assert row.split("|")[3].strip() == "-"
