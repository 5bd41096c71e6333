"""Pictures of grippers, with the axes of their tool centre points."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from graspcast.rendering.trials.gripper_picture import save_gripper_picture
from graspcast.simulation.grippers import FrankaHand
from graspcast.simulation.trial.gripper_measurement import measure_gripper


def _where(pixels: np.ndarray, colour: tuple[int, int, int]) -> tuple[float, float]:
    rows, columns = np.nonzero((pixels == np.array(colour)).all(axis=2))
    return float(columns.mean()), float(rows.mean())


def test_the_axes_point_where_the_tcp_says(tmp_path: Path) -> None:
    hand = FrankaHand()
    save_gripper_picture(tmp_path / "hand.png", hand, measure_gripper(hand), size=200)
    with Image.open(tmp_path / "hand.png") as image:
        picture = np.asarray(image.convert("RGB"))
    assert picture.shape == (270, 616, 3)
    first, second = picture[40:240, :200], picture[40:240, 208:408]
    red, green, blue = (205, 40, 40), (40, 150, 40), (40, 70, 210)
    # Seen along y: x to the right of z, which points down.
    assert _where(first, red)[0] > _where(first, blue)[0] + 10
    assert _where(first, blue)[1] > _where(first, red)[1] + 10
    # Seen along x: y to the side of z.
    assert abs(_where(second, green)[0] - _where(second, blue)[0]) > 10
    # The housing is above the TCP.
    grey = (first.max(axis=2) < 235) & (np.ptp(first.astype(int), axis=2) < 12)
    assert np.nonzero(grey)[0].mean() < _where(first, blue)[1]


@pytest.mark.slow
def test_without_a_measurement_the_axes_are_drawn_alone(tmp_path: Path) -> None:
    save_gripper_picture(tmp_path / "a.png", FrankaHand(), size=128)
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (400, 198)
