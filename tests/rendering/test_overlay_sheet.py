"""Sheets of overlays: pose errors and verdicts below each picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from bop_images import IMAGES, SIZE
from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import Results, read_results
from graspcast.errors import InputError, MismatchError
from graspcast.forecasting.verdict import VerdictRow
from graspcast.rendering.drawing import BAD, FAINT, GOOD, GUIDE, INK, LOOK
from graspcast.rendering.overlay import EDGE
from graspcast.rendering.overlay_sheet import overlay_sheet, overlays
from graspcast.views.next_look import NextLook
from overlays import verdict_row, write_estimates, written


@pytest.fixture
def world(tmp_path: Path) -> Path:
    return write_estimates(tmp_path)


def test_fields_tell_what_the_errors_are(world: Path) -> None:
    dataset = BopDataset(world / "made")
    results = {name: read_results(world / f"{name}_made-test.csv") for name in "ab"}
    fields = overlays(dataset, results, IMAGES, size=64)
    assert [(f.object, f.estimator) for f in fields[:4]] == [
        ("made-1", "a"), ("made-1", "b"), ("made-5", "a"), ("made-5", "b"),
    ]  # fmt: skip
    assert len(fields) == 2 * len(dataset.ground_truth)
    for field in fields:
        table = results[field.estimator]
        keys = (table.scene_id, table.im_id, table.obj_id)
        of = (field.scene_id, field.im_id, int(field.object[-1]))
        (row,) = np.flatnonzero(np.all([k == v for k, v in zip(keys, of, strict=True)], axis=0))
        true, est = dataset.ground_truth.cam_T_obj[row], table.cam_T_obj[row]
        assert field.translation_mm == pytest.approx(1000 * np.linalg.norm((est - true)[:3, 3]))
        cosine = (np.trace(est[:3, :3].T @ true[:3, :3]) - 1) / 2
        assert field.rotation_deg == pytest.approx(np.degrees(np.arccos(cosine)), rel=1e-6)


def test_without_ground_truth_there_is_the_estimate_alone(world: Path) -> None:
    dataset = BopDataset(world / "made")
    results = {"a": read_results(world / "a_made-test.csv")}
    known = overlays(dataset, results, [(1, 3)], size=64)
    for path in (world / "made").glob("test/*/scene_gt.json"):
        path.unlink()
    fields = overlays(BopDataset(world / "made"), results, [(1, 3)], size=64)
    assert [field.rotation_deg for field in fields] == [None, None]
    assert any((a.pixels != b.pixels).any() for a, b in zip(known, fields, strict=True))


def test_several_of_an_object_and_verdicts_on_each(world: Path) -> None:
    dataset = BopDataset(world / "made")
    table = read_results(world / "a_made-test.csv").select(np.array([0, 0]))
    shifted = table.cam_T_obj.copy()
    shifted[1, :3, 3] += [0.05, 0.0, 0.0]
    # The second row of the file has the higher score, so it is instance 0.
    table = replace(table, cam_T_obj=shifted, score=np.array([0.2, 0.9]))
    one = replace(table.select(np.array([1])), score=np.array([0.7]))
    verdicts = [
        verdict_row(1, 3, 1, 1, probability=0.2, cam_T_obj=table.cam_T_obj[0]),
        verdict_row(1, 3, 1, 0, probability=0.9, cam_T_obj=table.cam_T_obj[1]),
    ]
    fields = overlays(dataset, {"a": table, "b": one}, [(1, 3)], verdicts=verdicts, size=64)
    assert [field.pixels is None for field in fields] == [False, False, False, True]
    told = [[row.verdict.attempt for row in field.verdicts] for field in fields]
    assert told == [[True], [], [False], []]
    # The one true object belongs to the nearer of two estimates, or to the only one.
    assert [field.rotation_deg is None for field in fields] == [True, False, False, True]
    sheet = np.asarray(overlay_sheet(fields, estimators=2, size=64))
    # Captions that are wider than the pictures keep these apart.
    assert 4 * 64 + 3 * 8 < sheet.shape[1] < 1000
    for colour, half in ((GOOD, 0), (BAD, 1)):
        mine = np.array_split(sheet, 2, axis=1)[half]
        other = np.array_split(sheet, 2, axis=1)[1 - half]
        assert written(mine[64:], colour) > 10 and not written(other[64:], colour)
    missing = "no verdict on made-1 in image 1/3, est_id 1 by a"
    with pytest.raises(InputError, match=missing):
        overlays(dataset, {"a": table}, [(1, 3)], verdicts=verdicts[1:], size=64)
    stale = replace(table, score=table.score[::-1].copy())
    with pytest.raises(MismatchError, match="was on another pose than the one in"):
        overlays(dataset, {"a": stale}, [(1, 3)], verdicts=verdicts, size=64)
    # The principal's estimates have the verdicts, wherever it stands.
    fields = overlays(dataset, {"b": one, "a": table}, [(1, 3)], verdicts=verdicts, size=64)
    assert [[row.key.est_id for row in field.verdicts] for field in fields] == [[], [0]]
    with pytest.raises(
        MismatchError, match="verdicts are on estimates by a, but the estimates are by b"
    ):
        overlays(dataset, {"b": one}, [(1, 3)], verdicts=verdicts, size=64)


# --- Verdicts with several views ------------------------------------------------------------------


def several(world: Path) -> tuple[BopDataset, dict[str, Results], list[VerdictRow]]:
    """Verdicts by a fused pose 60 mm to the right of a's estimate: look again, and attempt."""
    grey = Image.new("RGB", SIZE, (90, 90, 90))
    grey.save(world / "made" / "test" / "000001" / "rgb" / "000003.png")
    dataset = BopDataset(world / "made")
    results = {name: read_results(world / f"{name}_made-test.csv") for name in "ab"}
    table = results["a"]
    first = np.flatnonzero((table.scene_id == 1) & (table.im_id == 3))
    rows = []
    for row in first.tolist():
        pose = table.cam_T_obj[row].copy()
        pose[0, 3] += 0.06
        given = verdict_row(1, 3, int(table.obj_id[row]), 3, probability=0.8, cam_T_obj=pose)
        rows.append(replace(given, principal="fused", views=3))
    now = -rows[0].cam_T_obj[:3, 3] / np.linalg.norm(rows[0].cam_T_obj[:3, 3])
    left = np.cross([0.0, 1.0, 0.0], now)
    left /= np.linalg.norm(left)
    direction = np.cos(0.6) * now + np.sin(0.6) * (left if left[0] < 0 else -left)
    look = NextLook(direction, None, -now, 0.01, 0.6, 0.84)
    verdict = replace(rows[0].verdict, attempt=False, probability=0.31, look=look)
    return dataset, results, [replace(rows[0], verdict=verdict), *rows[1:]]


def test_the_guiding_pose_is_drawn_on_all_estimates_of_its_instance(world: Path) -> None:
    dataset, results, verdicts = several(world)
    fields = overlays(dataset, results, [(1, 3)], verdicts=verdicts, size=160)
    plain = overlays(dataset, results, [(1, 3)], size=160)
    assert [len(field.verdicts) for field in fields] == [1, 0, 1, 0]
    for field in fields:
        (guide,) = field.guides
        row = verdicts[0 if field.object == "made-1" else 1]
        np.testing.assert_array_equal(guide.cam_T_obj, row.cam_T_obj)
        (true,) = np.flatnonzero(
            (dataset.ground_truth.scene_id == 1)
            & (dataset.ground_truth.im_id == 3)
            & (dataset.ground_truth.obj_id == int(field.object[-1]))
        )
        off = dataset.ground_truth.cam_T_obj[true, :3, 3] - row.cam_T_obj[:3, 3]
        assert guide.translation_mm == pytest.approx(1000 * np.linalg.norm(off))
        assert field.pixels is not None
        # Its outline is to the right of the estimate's.
        drawn = [np.argwhere(near(field.pixels, colour))[:, 1] for colour in (GUIDE, EDGE)]
        assert len(drawn[0]) > 20 and np.median(drawn[0]) > np.median(drawn[1]) + 8
    assert all(not field.guides and not near(field.pixels, GUIDE).any() for field in plain)


def near(pixels: np.ndarray | None, colour: tuple[int, int, int]) -> np.ndarray:
    assert pixels is not None
    return np.asarray(np.abs(pixels.astype(int) - colour).max(axis=2) < 45)


def test_looking_again_is_an_arrow_and_a_line(world: Path) -> None:
    dataset, results, verdicts = several(world)
    fields = overlays(dataset, {"a": results["a"]}, [(1, 3)], verdicts=verdicts, size=160)
    again, attempt = fields
    assert again.pixels is not None and attempt.pixels is not None
    arrow = np.argwhere(near(again.pixels, LOOK))
    # To the left, so near the left border at half the height.
    assert len(arrow) > 60 and (arrow[:, 1] < 0.2 * 160).all()
    assert abs(arrow[:, 0].mean() - 80) < 0.1 * 160
    sheet = np.asarray(overlay_sheet(fields, estimators=1, size=160))
    half = sheet.shape[1] // 2
    below = sheet[160:]
    assert written(below[:, :half], LOOK) > 30 and not written(below[:, :half], GOOD)
    assert written(below[:, half:], GOOD) > 30 and not written(below[:, half:], LOOK)
    # Object, errors, verdict, direction, guide; then the legend's two lines.
    for k, colour in enumerate([INK, FAINT, LOOK, LOOK, GUIDE]):
        assert written(sheet[160 + 14 * k : 174 + 14 * k, :half], colour) > 10
    legend = sheet[-28:, :half]
    assert written(legend[:14], EDGE) > 10 and written(legend[14:], GUIDE) > 10


@pytest.mark.parametrize(
    ("views", "probability", "expected", "said"),
    [
        (
            2,
            0.31,
            0.84,
            [
                "parallel: look again, probability 0.31, 2 views",
                "look from 34° left, expected 0.84",
            ],
        ),
        (1, None, None, ["parallel: look again, 1 view", "look from 34° left"]),
    ],
)
def test_captions_of_a_further_look(
    world: Path, views: int, probability: float | None, expected: float | None, said: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    dataset, results, verdicts = several(world)
    look = verdicts[0].verdict.look
    assert look is not None
    verdict = replace(
        verdicts[0].verdict,
        probability=probability,
        look=replace(look, expected_probability=expected),
    )
    rows = [replace(verdicts[0], verdict=verdict, views=views), verdicts[1]]
    fields = overlays(dataset, {"a": results["a"]}, [(1, 3)], verdicts=rows, size=64)
    heard: list[str] = []

    def spy(draw: Any, at: Any, text: str, *more: Any) -> None:
        heard.append(text)

    monkeypatch.setattr("graspcast.rendering.overlay_sheet.write", spy)
    overlay_sheet(fields, size=64)
    assert heard[2:4] == said
