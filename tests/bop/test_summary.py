"""Short descriptions of tables."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graspcast.bop.summary import summary
from graspcast.io.wording import counted
from poses import random_poses, results_of


def test_counts_have_their_number() -> None:
    assert [counted(n, "pose") for n in (0, 1, 2)] == ["0 poses", "1 pose", "2 poses"]


def test_images_of_different_scenes_with_the_same_number_are_different() -> None:
    table = replace(
        results_of(random_poses(6)),
        scene_id=np.array([1, 1, 1, 2, 2, 2]),
        im_id=np.array([0, 0, 1, 0, 1, 1]),
        obj_id=np.array([1, 5, 1, 1, 5, 9]),
        source="some/folder/epos_lmo-test.csv",
    )
    assert summary(table, "pose") == "6 poses of 3 objects in 4 images, epos_lmo-test.csv"
