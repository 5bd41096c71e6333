"""Choice among detections."""

from __future__ import annotations

from pathlib import Path

import pytest

from bop_images import box, write_boxes
from graspcast.bop.detection_choice import chosen
from graspcast.bop.detections import Detections, read_detections
from graspcast.bop.targets import Target
from graspcast.errors import InputError


@pytest.fixture
def found(tmp_path: Path) -> Detections:
    scores = [(1, 3, 1, 0.2), (1, 3, 1, 0.9), (1, 3, 5, 0.4), (2, 3, 1, 0.6)]
    entries = [
        box(s, i, category_id=o, score=score, bbox=[n + 1, 2, 10, 10])
        for n, (s, i, o, score) in enumerate(scores)
    ]
    return read_detections(write_boxes(tmp_path / "d.json", *entries))


def test_conditions(found: Detections) -> None:
    assert chosen(found) is found
    assert chosen(found, min_score=0.4).score.tolist() == [0.9, 0.4, 0.6]
    assert chosen(found, top=1).score.tolist() == [0.9, 0.4, 0.6]
    assert chosen(found, targets=[Target(1, 3, 5, 1)]).score.tolist() == [0.4]
    assert chosen(found, targets=[Target(2, 3)]).score.tolist() == [0.6]
    both = chosen(found, top=1, targets=[Target(1, 3)], min_score=0.5)
    assert both.score.tolist() == [0.9]
    assert both.remarks[-1].endswith(
        "of 4 detections 1 are no targets, 2 have a score below 0.5, 0 are not among the best 1 of "
        "their object"
    )
    assert found.in_file and not both.in_file


def test_none_left_says_the_highest_score(found: Detections) -> None:
    with pytest.raises(InputError, match=r"none is left \(the highest score is 0\.9\)") as caught:
        chosen(found, min_score=0.95)
    assert "min_score" in caught.value.parameters
