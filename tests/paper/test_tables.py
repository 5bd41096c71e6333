"""The paper's tables: ours against the printed ones."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

from graspcast.errors import InputError
from graspcast.paper.configurations import CONFIGURATIONS, PROTOCOLS, Protocol
from graspcast.paper.dataset import ESTIMATORS, GRIPPERS, OBJECTS, Published
from graspcast.paper.render import render
from graspcast.paper.tables import paper_tables, reproduce, table1, table2, table3_baseline

DIGITS = {"rotation_deg": 2, "translation_mm": 1, "parallel": 3, "underactuated": 3}


def test_table_one(data: Published) -> None:
    ours, paper = table1(data.outcomes), paper_tables()["table1"]
    assert list(ours) == list(OBJECTS)
    compared = 0
    for name in OBJECTS:
        for estimator in ESTIMATORS:
            for gripper in GRIPPERS:
                printed = paper[name][estimator][gripper]
                if printed is None:
                    assert (name, gripper) == ("lmo-10", "parallel")
                    assert ours[name][estimator][gripper] is None
                    continue
                assert ours[name][estimator][gripper] == pytest.approx(printed, abs=0.0012)
                compared += 1
    assert compared == 87


def test_table_one_by_hand() -> None:
    outcomes = pl.DataFrame(
        {
            "dataset": ["lmo"] * 4,
            "obj_id": [1, 1, 1, 5],
            "estimator": ["epos"] * 4,
            "gripper": ["parallel", "parallel", "parallel", "underactuated"],
            "success": [1, 0, 1, 1],
        }
    )
    rates = table1(outcomes)
    assert rates["lmo-1"]["epos"] == {"parallel": pytest.approx(2 / 3), "underactuated": None}
    assert rates["lmo-5"]["epos"] == {"parallel": None, "underactuated": 1.0}


@pytest.mark.slow
def test_table_two(data: Published) -> None:
    ours, paper = table2(data), paper_tables()["table2"]
    assert {d: set(rows) for d, rows in ours.items()} == {
        d: set(ESTIMATORS) for d in ("lmo", "ycbv")
    }
    for dataset, rows in paper.items():
        for estimator, printed in rows.items():
            for measure, places in DIGITS.items():
                half = 0.5 * 10.0**-places + 1e-9
                assert ours[dataset][estimator][measure] == pytest.approx(
                    printed[measure], abs=half
                ), (dataset, estimator, measure)


@pytest.mark.slow
def test_the_baselines_row_of_table_three(data: Published) -> None:
    ours, note = table3_baseline(data)
    printed = paper_tables()["table3"]["baseline"]
    for gripper in GRIPPERS:
        assert round(ours[gripper], 3) == printed["average"][gripper]
        for estimator in ESTIMATORS:
            assert round(ours["by_principal"][estimator][gripper], 3) == printed[estimator][gripper]
    assert [round(ours["by_principal"][e]["parallel"], 3) for e in ESTIMATORS] == [
        0.792,
        0.840,
        0.759,
    ]
    assert [round(ours["by_principal"][e]["underactuated"], 3) for e in ESTIMATORS] == [
        0.863,
        0.849,
        0.863,
    ]
    assert note["add"] == "as released"
    assert len(note["deviating_cells"]) == 5
    assert note["meshes"]["underactuated"] == ours["underactuated"]


@pytest.mark.slow
def test_without_the_release_add_comes_from_the_meshes(data: Published, tmp_path: Path) -> None:
    for name in ("published", "bop"):
        (tmp_path / name).symlink_to(data.directory / name)
    ours, note = table3_baseline(Published(tmp_path))
    assert note == {"add": "from the object models"}
    assert ours["underactuated"] == pytest.approx(0.858, abs=5e-4)
    assert ours["parallel"] == pytest.approx(0.797, abs=5e-3)


def test_a_directory_without_the_data_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no published/lmo/trials\.csv here; the directory"):
        Published(tmp_path)


# --- The whole reproduction -----------------------------------------------------------------------

WITHOUT_SELECTION: dict[tuple[str, Protocol], tuple[float, float]] = {
    ("MLP", "paper"): (0.848, 0.888),
    ("MLP", "last"): (0.802, 0.843),
    ("MLP-O", "paper"): (0.870, 0.903),
    ("MLP-O", "last"): (0.803, 0.847),
}
"""Measured with another implementation, mean over principals: parallel, underactuated."""


@pytest.mark.slow
def test_the_whole_reproduction(data: Published) -> None:
    reported: list[tuple[float, str]] = []
    found = reproduce(data, progress=lambda share, message: reported.append((share, message)))
    again = json.loads(json.dumps(found, allow_nan=False))
    assert set(again) == {
        "table1",
        "table2",
        "table3",
        "baseline",
        "majority",
        "seeds",
        "seconds",
    }
    table3 = again["table3"]
    assert set(table3) == {"baseline", *CONFIGURATIONS}
    assert set(table3["baseline"]) == {"fitted"}
    for method in CONFIGURATIONS:
        assert set(table3[method]) == set(PROTOCOLS)
        for protocol in PROTOCOLS:
            averages = table3[method][protocol]
            assert set(averages) == {*GRIPPERS, "by_principal"}
            for gripper in GRIPPERS:
                each = [averages["by_principal"][e][gripper] for e in ESTIMATORS]
                assert averages[gripper] == pytest.approx(sum(each) / 3)
        # The choice by test accuracy flatters.
        for gripper in GRIPPERS:
            assert table3[method]["paper"][gripper] > table3[method]["last"][gripper]
    for (method, protocol), expected in WITHOUT_SELECTION.items():
        for gripper, figure in zip(GRIPPERS, expected, strict=True):
            assert table3[method][protocol][gripper] == pytest.approx(figure, abs=0.03)
    assert round(again["majority"]["parallel"], 3) == 0.755
    assert round(again["majority"]["underactuated"], 3) == 0.808
    assert again["seconds"] > 0
    shares = [share for share, _ in reported]
    assert shares == sorted(shares)
    assert shares[-1] == 1
    assert {message for _, message in reported} == {f"training {name}" for name in CONFIGURATIONS}
    text = render(found)
    assert "| MLP-OG (paper) " in text
    assert "nan" not in text
