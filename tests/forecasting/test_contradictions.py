"""Instances whose views contradict each other."""

from __future__ import annotations

from pathlib import Path

from graspcast.bop.models import Models
from graspcast.forecasting.contradictions import CONTRADICTED, MOVED, single_view_doubts
from looked_at import CAMERAS, NAMES, fused
from poses import write_models
from static_scenes import estimates_of, motion_of, objects, scattered, seen


def test_a_view_that_contradicts_the_judged_one_is_outvoted_by_one_that_agrees(
    tmp_path: Path,
) -> None:
    poses = seen(CAMERAS, objects(2, 500))
    poses[1, 0, 0, 3] += 0.1
    models = {"d": Models(write_models(tmp_path, obj_1={}, obj_2={}))}
    tables = {n: estimates_of(scattered(poses, 800 + k)) for k, n in enumerate(NAMES)}
    for images, says in ((1, [""]), (2, [CONTRADICTED] * 2), (3, ["", MOVED, ""])):
        some = {n: t.select(t.im_id < images) for n, t in tables.items()}
        found = fused(some, models, motion_of(CAMERAS))
        doubts = single_view_doubts(found)
        mine = [d for d, o in zip(doubts, found.instances.obj_id.tolist(), strict=True) if o == 1]
        others = [d for d, o in zip(doubts, found.instances.obj_id.tolist(), strict=True) if o == 2]
        assert mine == says and others == [""] * images
