"""Pictures with captions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from graspcast.errors import InputError
from graspcast.rendering.drawing import GOOD, PAPER, blank, save_png, width_of, write


def test_text_is_as_wide_as_measured_and_of_its_colour() -> None:
    paper, draw = blank(300, 40)
    write(draw, (10, 20), "made-1 by parallel", 18, GOOD, "lm")
    pixels = np.asarray(paper)
    inked = np.flatnonzero((pixels != PAPER).any(axis=(0, 2)))
    assert inked[0] >= 9
    assert inked[-1] - 10 == pytest.approx(width_of("made-1 by parallel", 18), abs=3)
    assert (pixels == GOOD).all(axis=-1).any()


def test_a_picture_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    paper, _ = blank(8, 6)
    save_png(tmp_path / "a.png", paper)
    with Image.open(tmp_path / "a.png") as image:
        assert (image.format, image.size) == ("PNG", (8, 6))
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        save_png(tmp_path / "file" / "b.png", paper)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "file"]
