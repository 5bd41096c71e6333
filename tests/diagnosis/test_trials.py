"""Outcome tables."""

from __future__ import annotations

from pathlib import Path

import polars as pl

from graspcast.diagnosis.trials import outcome_findings, shared_scenes
from graspcast.estimates.outcomes import ERROR_COLUMNS, checked_outcomes
from sick_files import case_of, healthy


def table(images: range, success: int | None = None, scene: int = 1) -> pl.DataFrame:
    n = len(images)
    return checked_outcomes(
        pl.DataFrame(
            {
                "estimator": ["a"] * n,
                "dataset": ["toy"] * n,
                "scene_id": [scene] * n,
                "im_id": list(images),
                "obj_id": [1] * n,
                "gripper": ["parallel"] * n,
                "success": [i % 2 if success is None else success for i in images],
            }
        )
    )


def codes(tmp_path: Path, tables: dict[str, pl.DataFrame]) -> list[str]:
    case = case_of(healthy().write(tmp_path))
    return [f.code for f in outcome_findings(case, {Path(n): t for n, t in tables.items()})]


def test_nothing_of_one_sound_table(tmp_path: Path) -> None:
    assert codes(tmp_path, {"t.csv": table(range(24)), "t.parquet": table(range(24))}) == []


def test_two_tables_that_share_trials(tmp_path: Path) -> None:
    first = table(range(20))
    same, other = table(range(10, 24)), table(range(10, 24), success=0)
    assert codes(tmp_path / "1", {"a.csv": first, "b.csv": same}) == ["outcomes-repeated"]
    assert codes(tmp_path / "2", {"a.csv": first, "b.csv": other}) == ["outcomes-contradict"]


def test_trials_of_two_poses_by_one_name_do_not_contradict(tmp_path: Path) -> None:
    zero = {name: pl.lit(0.0) for name in ERROR_COLUMNS}
    first = table(range(20)).with_columns(**zero)
    moved = table(range(10, 24), success=0).with_columns(**{**zero, "error_z_m": pl.lit(0.01)})
    one, other = tmp_path / "1", tmp_path / "2"
    assert codes(one, {"a.csv": first, "b.csv": moved}) == ["outcomes-other-poses"]
    same = table(range(10, 24), success=0).with_columns(**zero)
    assert codes(other, {"a.csv": first, "b.csv": same}) == ["outcomes-contradict"]


def test_constant_and_unmatched_outcomes(tmp_path: Path) -> None:
    assert codes(tmp_path / "1", {"a.csv": table(range(24), 1)}) == ["outcomes-constant"]
    assert codes(tmp_path / "2", {"a.csv": table(range(100, 110))}) == ["outcomes-unmatched"]


def test_scenes_in_two_roles() -> None:
    def found(calibration: pl.DataFrame) -> list[tuple[str, str]]:
        given = {Path("c.csv"): calibration}
        return [
            (f.severity, f.code) for f in shared_scenes({Path("t.csv"): table(range(10))}, given)
        ]

    assert found(table(range(5, 15))) == [("error", "shared-images")]
    assert found(table(range(10, 20))) == [("warning", "shared-scenes")]
    assert found(table(range(10, 20), scene=2)) == []


def with_errors(metres: float, radians: float | None) -> pl.DataFrame:
    values = {n: metres if n.endswith("_m") else radians for n in ERROR_COLUMNS}
    columns = {name: pl.lit(value, pl.Float64) for name, value in values.items()}
    return table(range(24)).with_columns(**columns)


def test_errors_in_other_units(tmp_path: Path) -> None:
    assert codes(tmp_path / "1", {"a.csv": with_errors(0.003, 0.1)}) == []
    assert codes(tmp_path / "2", {"a.csv": with_errors(3.0, 0.1)}) == ["outcomes-unit"]
    assert codes(tmp_path / "3", {"a.csv": with_errors(0.003, 5.7)}) == ["outcomes-unit"]
    assert codes(tmp_path / "4", {"a.csv": with_errors(3.0, None)}) == []


def test_tables_of_different_trials(tmp_path: Path) -> None:
    tables = {"a.csv": table(range(12)), "b.csv": table(range(12, 24))}
    assert codes(tmp_path, tables) == []
