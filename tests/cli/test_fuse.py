"""The verb fuse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from commands import refused
from graspcast.bop.results import read_results, write_results
from graspcast.cli import main
from poses import write_models
from static_scenes import estimates_of, objects, orbit, scattered, seen

CAMERAS = orbit(8)
POSES = seen(CAMERAS, objects(2))


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    """A dataset of two objects in eight images, two estimators, and camera poses."""
    for seed, name in enumerate("ab"):
        write_results(tmp_path / f"{name}_made-test.csv", estimates_of(scattered(POSES, seed)))
    write_models(tmp_path / "made" / "models", obj_1={}, obj_2={})
    rows = [f"1,{i},{' '.join(map(repr, pose.ravel().tolist()))}" for i, pose in enumerate(CAMERAS)]
    (tmp_path / "cameras.csv").write_text("\n".join(["scene_id,im_id,world_T_cam_m", *rows]))
    return tmp_path


def arguments(scene: Path, *more: str, names: str = "ab") -> list[str]:
    out = ["fuse", "--out", str(scene / "fused_made-test.csv"), "--bop", str(scene / "made")]
    for name in names:
        out += ["--estimates", f"{name}={scene / f'{name}_made-test.csv'}"]
    return [*out, "--camera-poses", str(scene / "cameras.csv"), *more]


def test_fuse_writes_results_and_covariances(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    side = scene / "covariances.parquet"
    more = ("--covariances", str(side), "--views-from", "all", "--camera-noise", "1mm,0.1deg")
    assert main(arguments(scene, *more, "--principal", "b")) == 0
    out, _ = capsys.readouterr()
    assert "fused_made-test.csv: a, b; 16 instances: 16 from 3 views" in out
    fused = read_results(scene / "fused_made-test.csv")
    keys = zip(fused.im_id.tolist(), fused.obj_id.tolist(), strict=True)
    true = np.stack([POSES[im_id, obj_id - 1] for im_id, obj_id in keys])
    assert np.median(np.linalg.norm(fused.cam_T_obj - true, axis=(1, 2))) < 0.1
    table = pl.read_parquet(side)
    assert len(table) == 16 and "cov_obj_55" in table.columns
    np.testing.assert_array_equal(table["score"], fused.score)


def test_the_output_is_an_estimator_for_other_verbs(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments(scene, names="a")) == 0
    out, _ = capsys.readouterr()
    assert "no earlier image" in out
    again = ["fuse", "--out", str(scene / "x_made-test.csv"), "--bop", str(scene / "made")]
    for name in ("a", "b", "fused"):
        again += ["--estimates", f"{name}={scene / f'{name}_made-test.csv'}"]
    assert main([*again, "--max-views", "1", "--covariances", str(scene / "c.csv")]) == 0
    assert (pl.read_csv(scene / "c.csv")["views"] == 1).all()


def test_what_is_wrong_is_told(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wrong = scene / "wrong.csv"
    text = (scene / "cameras.csv").read_text()
    for change, says in (
        (text.replace("world_T_cam_m", "world_T_cam"), "world_T_cam_tx_m"),
        (text.replace("world_T_cam_m", "world_T_cam_mm"), "in metres instead of millimetres"),
        (text.replace("world_T_cam_m", "cam_T_world_m"), "read in the other direction"),
        (text.replace("\n1,", "\n9,"), "of other scenes (9 …) than the estimates (1 …)"),
    ):
        wrong.write_text(change)
        given = arguments(scene)
        given[given.index("--camera-poses") + 1] = str(wrong)
        err = refused(given, capsys)
        assert says in err and "(see --camera-poses)" in err
        assert not (scene / "fused_made-test.csv").exists()
    noise = refused(arguments(scene, "--camera-noise", "1,0.1"), capsys)
    assert "for example 1mm,0.1deg" in noise and "(see --camera-noise)" in noise
    assert "unknown estimator 'z'" in refused(arguments(scene, "--principal", "z"), capsys)
    here = str(scene / "cameras.csv")
    assert "would be replaced" in refused(arguments(scene, "--covariances", here), capsys)
    out = str(scene / "fused_made-test.csv")
    assert "--out and as --covariances" in refused(arguments(scene, "--covariances", out), capsys)


def test_without_camera_poses_one_view_is_offered(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    err = refused(arguments(scene)[:-2], capsys)
    assert "takes camera poses" in err and "(see --camera-poses, --max-views)" in err
    assert main([*arguments(scene)[:-2], "--max-views", "1"]) == 0


@pytest.mark.parametrize("value", ["x", "-1", "181", "nan"])
def test_degrees_out_of_range(scene: Path, value: str) -> None:
    with pytest.raises(SystemExit):
        main(arguments(scene, "--min-parallax", value))


def test_motion_from_the_estimates_of_other_objects(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Here are two objects: one other object is not enough, which is said."""
    given = [*arguments(scene)[:-2], "--motion-from", "estimates", "--views-from", "all"]
    assert main(given) == 0
    out, _ = capsys.readouterr()
    assert "16 instances: 16 from 1 view" in out
    assert "left out 112 views since fewer than two other objects agree on the motion" in out
    write_models(scene / "made" / "models", **{f"obj_{i}": {} for i in range(1, 6)})
    poses = seen(CAMERAS, objects(5))
    for seed, name in enumerate("ab"):
        write_results(scene / f"{name}_made-test.csv", estimates_of(scattered(poses, seed)))
    assert main(given) == 0
    out, _ = capsys.readouterr()
    assert "40 instances: " in out and " from 3 views" in out
    both = refused([*given, "--camera-poses", str(scene / "cameras.csv")], capsys)
    assert "either that of the camera poses or taken from estimates" in both
    assert "(see --camera-poses, --motion-from)" in both


def test_a_value_of_the_wrong_kind_is_told_by_its_option(
    scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = refused(arguments(scene, "--max-views", "2000"), capsys)
    assert "fuse: --max-views should be a number from 1 to 1000, not 2000" in said
    assert "fuse_estimates" not in said


def test_one_instance_is_no_plural(scene: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for seed, name in enumerate("ab"):
        first = estimates_of(scattered(POSES[:1, :1], seed))
        write_results(scene / f"{name}_made-test.csv", first)
    assert main(arguments(scene)) == 0
    out = capsys.readouterr().out
    assert "1 instance: 1 from 1 view\n" in out
    assert "single views: 1 instance has no earlier image" in out
