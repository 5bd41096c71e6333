from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

from graspcast.simulation.campaign.store import COLUMNS


def test_the_card_reads_as_it_says(complete: Path) -> None:
    card = (complete / "README.md").read_text()
    outcomes = pl.read_parquet(complete / "outcomes.parquet")
    for name in outcomes.columns:
        assert f"| `{name}` " in card
    manifest = json.loads((complete / "manifest.json").read_text())
    for name in manifest["setups"][0]["settings"]:
        assert f"| `{name}` " in card
    rates = " ".join(card.split())  # without the padding of columns
    assert f"| epos | parallel | 40 | {outcomes['success'].mean():.3f} |" in rates
    assert "CC BY 4.0" in card and "- epos: a test" in card and "LM-O" not in card
    pandas = pytest.importorskip("pandas", reason="needs pandas: pip install pandas")
    pytest.importorskip("pyarrow", reason="needs PyArrow: pip install pyarrow")
    frame = pandas.read_parquet(complete / "outcomes.parquet")
    assert list(frame.columns) == list(COLUMNS) and len(frame) == 40
    datasets = pytest.importorskip("datasets", reason="needs datasets: pip install datasets")
    assert datasets.load_dataset(str(complete), split="train").num_rows == 40
