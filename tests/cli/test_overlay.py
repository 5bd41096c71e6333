"""The verb overlay."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from commands import refused
from graspcast.bop.results import read_results, write_results
from graspcast.cli import main
from graspcast.forecasting.verdict_file import write_verdicts
from graspcast.rendering.drawing import GOOD, GUIDE
from overlays import verdict_row, write_estimates, written


@pytest.fixture
def world(tmp_path: Path) -> Path:
    return write_estimates(tmp_path)


def command(world: Path, *more: str, names: str = "a") -> list[str]:
    estimates = [f"--estimates={name}={world / f'{name}_made-test.csv'}" for name in names]
    out = ["--bop", str(world / "made"), "--out", str(world / "o.png")]
    return ["overlay", *estimates, *out, *more]


def test_the_verb_writes_a_sheet(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = read_results(world / "a_made-test.csv")
    keys = zip(table.scene_id.tolist(), table.im_id.tolist(), table.obj_id.tolist(), strict=True)
    rows = [
        verdict_row(*key, probability=0.7, cam_T_obj=pose)
        for key, pose in zip(keys, table.cam_T_obj, strict=True)
    ]
    write_verdicts(world / "v.csv", rows)
    more = ["--image", "1/3", "--image", "2/3", "--size", "80", "--verdicts", str(world / "v.csv")]
    assert main(command(world, *more, names="ab")) == 0
    assert capsys.readouterr().out.strip() == str(world / "o.png")
    with Image.open(world / "o.png") as image:
        assert image.width > 4 * 80 + 3 * 8
        assert 2 * 80 < image.height < 4 * 80
        assert written(np.asarray(image)[80:130], GOOD) > 10
    assert main(command(world, "--image", "1/3", "--objects", "made-5", "--size", "80")) == 0
    with Image.open(world / "o.png") as image:
        assert 80 <= image.width < 200


def test_verdicts_of_fused_poses_are_drawn(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = read_results(world / "a_made-test.csv")
    pose = table.cam_T_obj[0].copy()
    pose[0, 3] += 0.05
    where = [int(c[0]) for c in (table.scene_id, table.im_id, table.obj_id)]
    row = replace(verdict_row(*where, probability=0.7, cam_T_obj=pose), principal="fused", views=3)
    write_verdicts(world / "v.csv", [row])
    image = ["--image", f"{where[0]}/{where[1]}", "--objects", str(where[2]), "--size", "80"]
    assert main(command(world, *image, "--verdicts", str(world / "v.csv"))) == 0
    with Image.open(world / "o.png") as drawn:
        pixels = np.asarray(drawn)
    left = (pixels.shape[1] - 80) // 2
    assert written(pixels[:80, left : left + 80], GUIDE) > 20
    assert written(pixels[80:], GOOD) > 10


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--image", "7/1"], "no estimate of made in image 7/1; it has one in 1/3, 1/8, 2/3"),
        (["--image", "1/3", "--objects", "7"], "no estimate is left of object 7; the file has"),
        (
            ["--image", "1/3", "--objects", "5", "7"],
            "unknown object 'made-7' (did you mean 'made-5'?); known: made-1, made-5",
        ),
        (["--image", "1/3", "--objects", "lmo-5"], "there are only estimates of dataset made"),
        (["--image", "1/3", "--verdicts", "none.csv"], "none.csv: cannot be read"),
        (["--image", "1/3", "--out", "o.jpg"], "drawn to .png"),
    ],
)
def test_what_cannot_be_drawn_is_said(
    world: Path, more: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert says in refused(command(world, *more), capsys)
    assert not (world / "o.png").exists()


def test_estimates_of_other_images_verdicts_and_points_are_refused(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_verdicts(world / "v.csv", [verdict_row(9, 9, 1, probability=0.7)])
    asked = command(world, "--image", "1/3", "--verdicts", str(world / "v.csv"))
    assert "no verdict on made-1 in image 1/3, est_id 0 by a" in refused(asked, capsys)
    (world / "made" / "test" / "000001" / "rgb" / "000003.png").unlink()
    assert "no image 1/3" in refused(command(world, "--image", "1/3"), capsys)
    path = world / "made" / "models" / "obj_000001.ply"
    text = path.read_text().replace("element face 2", "element face 0")
    path.write_text(text.replace("3 0 1 2\n3 1 3 2\n", ""))
    said = refused(command(world, "--image", "2/3"), capsys)
    assert "obj_000001.ply: has no faces" in said
    assert not (world / "o.png").exists()


@pytest.mark.slow
def test_real_images_of_lmo(data_dir: Path, tmp_path: Path) -> None:
    published = data_dir / "published" / "lmo"
    names = {"epos": "epos_lmo-test.csv", "zebrapose": "zebrapose_lmo-test.csv"}
    estimates = [f"--estimates={name}={published / file}" for name, file in names.items()]
    out = ["--size", "200", "--out", str(tmp_path / "o.png")]
    bop = ["--bop", str(data_dir / "bop" / "lmo"), "--image", "2/3", "--objects", "5"]
    assert main(["overlay", *estimates, *bop, *out]) == 0
    with Image.open(tmp_path / "o.png") as image:
        assert image.width == 2 * 200 + 8


def test_one_dataset_and_objects_with_estimates_are_drawn(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = read_results(world / "a_made-test.csv")
    only = table.select((table.obj_id == 1) | (table.im_id != 3))
    write_results(world / "a_made-test.csv", only)
    asked = command(world, "--image", "1/3", "--objects", "made-1", "made-5")
    assert "--objects made-5: no estimate of it in any --image" in refused(asked, capsys)
    assert not (world / "o.png").exists()
