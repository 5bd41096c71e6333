"""Rendered datasets: reproducibility, the BOP layout, bad input."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from graspcast.bop.dataset import BopDataset, read_targets
from graspcast.cli import main
from graspcast.errors import InputError, UnknownNameError
from graspcast.pose.transforms import transform_points
from graspcast.rendering.synthetic.camera import INTRINSICS
from graspcast.rendering.synthetic.dataset import RenderSettings, read_models, render_dataset


def digests(root: Path) -> dict[str, str]:
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def test_the_same_seed_the_same_files_and_more_scenes_leave_the_first_alone(
    models: Path, tmp_path: Path
) -> None:
    one = render_dataset(models, tmp_path / "one", RenderSettings(scenes=1, images=2, seed=3))
    again = render_dataset(models, tmp_path / "again", RenderSettings(scenes=1, images=2, seed=3))
    more = render_dataset(models, tmp_path / "more", RenderSettings(scenes=2, images=2, seed=3))
    other = render_dataset(models, tmp_path / "other", RenderSettings(scenes=1, images=2, seed=4))
    assert digests(one) == digests(again)
    assert digests(one / "test" / "000001") == digests(more / "test" / "000001")
    assert digests(one / "test" / "000001") != digests(other / "test" / "000001")


def test_our_own_reader_reads_all_of_it(models: Path, tmp_path: Path) -> None:
    settings = RenderSettings(scenes=2, images=2, seed=1, image_format="png")
    root = render_dataset(models, tmp_path / "made", settings, obj_ids=[1, 7])
    dataset = BopDataset(root)
    truth = dataset.ground_truth
    assert set(truth.obj_id.tolist()) <= {1, 7} and len(truth) >= 4
    assert sorted(dataset.images) == [(1, 0), (1, 1), (2, 0), (2, 1)]
    assert dataset.image(2, 1).shape == (480, 640, 3)
    np.testing.assert_allclose(dataset.camera_of(1, 0).K, INTRINSICS)
    assert ((truth.visib_fract >= 0) & (truth.visib_fract <= 1)).all()
    targets = {
        (t.scene_id, t.im_id, t.obj_id) for t in read_targets(root / "test_targets_bop19.json")
    }
    rows = zip(truth.scene_id, truth.im_id, truth.obj_id, truth.visib_fract, strict=True)
    assert targets == {(s, i, o) for s, i, o, share in rows if share >= 0.1}
    assert dataset.models.mesh(7).vertices.shape == read_models(models)[7].vertices.shape
    # The box spans the projected mesh (another route than the silhouette that it was made from).
    assert truth.box_xywh is not None
    for k in range(len(truth)):
        points = dataset.models.mesh(int(truth.obj_id[k])).vertices
        pixels = transform_points(truth.cam_T_obj[k], points) @ INTRINSICS.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        x, y, width, height = truth.box_xywh[k]
        spans = [x - 0.5, y - 0.5, x + width - 0.5, y + height - 0.5]
        wanted = [*pixels.min(axis=0), *pixels.max(axis=0)]
        np.testing.assert_allclose(spans, wanted, atol=1.2)
    made = json.loads((root / "render.json").read_text())
    assert made["settings"]["seed"] == 1 and "mujoco" in made["versions"]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scenes": 0}, "at least one"),
        ({"images": -1}, "at least one"),
        ({"image_format": "bmp"}, "jpg, png, webp"),
        ({"quality": 101}, "1 to 100"),
        ({"seed": -1}, "0 or more"),
    ],
)
def test_settings_that_make_no_sense(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        RenderSettings(**changes)  # type: ignore[arg-type]


def test_what_cannot_be_rendered_leaves_nothing(
    models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(UnknownNameError, match="unknown object '2'; known: 1, 4, 7"):
        render_dataset(models, tmp_path / "a", obj_ids=[2])
    full = tmp_path / "full"
    full.mkdir()
    (full / "kept").write_text("mine")
    assert main(["render", "--models", str(models), "--out", str(full)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["render", "--models", str(tmp_path), "--out", str(tmp_path / "b")]) == 2
    assert "models_info.json" in capsys.readouterr().err
    for split in ("../out", "models", "a/b", ""):
        command = [
            "render",
            "--models",
            str(models),
            "--out",
            str(tmp_path / "c"),
            "--split",
            split,
        ]
        assert main(command) == 2
        assert "a split is a name such as test" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["full"]
    assert [p.name for p in full.iterdir()] == ["kept"]


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
def test_without_opengl_one_message_and_nothing_written(models: Path, tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "graspcast",
        "render",
        "--models",
        str(models),
        "--scenes",
        "1",
    ]
    source = str(Path(__file__).parents[3] / "src")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("MUJOCO", "PYOPENGL"))}
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out")],
        env={**clean, "PYTHONPATH": source, "MUJOCO_EGL_DEVICE_ID": "99"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2 and "libegl1" in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
