"""Image files of a dataset."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from graspcast.diagnosis.images import image_findings
from sick_files import IMAGES, case_of, healthy


@pytest.mark.parametrize(
    ("size", "same", "expected"),
    [
        ((640, 480), False, []),
        ((640, 480), True, ["duplicate-images"]),
        ((320, 240), False, ["image-size"]),
    ],
)
def test_images(tmp_path: Path, size: tuple[int, int], same: bool, expected: list[str]) -> None:
    paths = healthy(names=()).write(tmp_path)
    folder = tmp_path / "toy" / "test" / "000001" / "rgb"
    folder.mkdir()
    for i in range(IMAGES):
        value = 5 if same and i in (5, 9) else i
        colour = np.full((size[1], size[0], 3), value, dtype=np.uint8)
        Image.fromarray(colour).save(folder / f"{i:06d}.png")
    assert [f.code for f in image_findings(case_of(paths))] == expected


def test_a_broken_image_and_images_of_other_numbers(tmp_path: Path) -> None:
    paths = healthy(names=()).write(tmp_path)
    folder = tmp_path / "toy" / "test" / "000001" / "rgb"
    folder.mkdir()
    (folder / "000900.png").write_bytes(b"nothing")
    found = [f.code for f in image_findings(case_of(paths))]
    assert found == ["images-unreadable", "images-unmatched"]


def test_images_with_intrinsics_of_their_own_may_have_another_size(tmp_path: Path) -> None:
    paths = healthy(names=()).write(tmp_path)
    folder = tmp_path / "toy" / "test" / "000001"
    (folder / "rgb").mkdir()
    for i in range(IMAGES):
        Image.new("RGB", (320, 240), (i, 0, 0)).save(folder / "rgb" / f"{i:06d}.png")
    own = {str(i): {"cam_K": [300.0, 0, 160, 0, 300, 120, 0, 0, 1]} for i in range(IMAGES)}
    (folder / "scene_camera.json").write_text(json.dumps(own))
    assert [f.code for f in image_findings(case_of(paths))] == []
    (folder / "scene_gt.json").unlink()
    assert [f.code for f in image_findings(case_of(paths))] == []
