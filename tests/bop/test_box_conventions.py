"""Conventions of boxes, held against the sizes of their images."""

from __future__ import annotations

import numpy as np
import pytest

from graspcast.bop.box_conventions import check_convention
from graspcast.errors import FormatError

CORNERS = np.array([[50.0, 30, 90, 60], [60, 20, 95, 50], [40, 30, 80, 63], [70, 40, 90, 60]])
WIDE = np.full((4, 2), (192.0, 128.0))


def test_corners_are_told_by_the_size() -> None:
    with pytest.raises(
        FormatError, match=r"4 of 4 boxes end beyond the image of 96 x 64 .*two cor"
    ):
        check_convention(CORNERS, (96, 64), "f")
    (said,) = check_convention(CORNERS[:2], (96, 64), "f")
    assert said.endswith("are they two corners?")


def test_the_sizes_of_the_images_decide() -> None:
    asked = []

    def sizes() -> np.ndarray:
        asked.append(True)
        return WIDE

    assert check_convention(CORNERS, (96, 64), "f", sizes) == ()
    assert check_convention(CORNERS, None, "f", sizes) == ()
    assert len(asked) == 2
    assert check_convention(CORNERS / 2, (96, 64), "f", sizes) == ()
    assert len(asked) == 2, "they fit the common size"
    with pytest.raises(FormatError, match="these are two corners"):
        check_convention(2 * CORNERS, None, "f", sizes)
    assert check_convention(CORNERS, None, "f", lambda: np.full((4, 2), np.nan)) == ()


def test_shares_of_the_image() -> None:
    with pytest.raises(FormatError, match=r"are they shares of the image\?"):
        check_convention(CORNERS / 100, None, "f")
    assert check_convention(np.empty((0, 4)), (96, 64), "f") == ()


def test_boxes_of_images_of_unknown_size_are_taken_as_they_are() -> None:
    assert check_convention(CORNERS, None, "f") == ()
