from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from graspcast.errors import MismatchError
from graspcast.estimates.image_split import BLOCKS, SPLITS, frames_of, split_of


def _splits(frames: np.ndarray) -> np.ndarray:
    names, scenes = np.full(len(frames), "d"), np.full(len(frames), 7)
    return split_of(names, scenes, frames, {("d", 7): frames})


@given(st.sets(st.integers(0, 5000), min_size=BLOCKS, max_size=300))
def test_a_scene_is_six_contiguous_blocks_assigned_in_turn(numbers: set[int]) -> None:
    splits = _splits(np.array(sorted(numbers)))
    starts = np.flatnonzero(np.r_[True, splits[1:] != splits[:-1]])
    assert splits[starts].tolist() == 2 * list(SPLITS)
    sizes = np.diff(np.r_[starts, len(splits)])
    assert sizes.max() - sizes.min() <= 1


@given(
    st.sets(st.integers(0, 5000), min_size=BLOCKS, max_size=100),
    st.randoms(use_true_random=False),
)
def test_the_split_depends_on_the_image_alone(numbers: set[int], random: object) -> None:
    frames = np.array(sorted(numbers))
    expected = dict(zip(frames.tolist(), _splits(frames).tolist(), strict=True))
    some = np.random.default_rng(len(numbers)).choice(frames, size=2 * len(frames))
    names, scenes = np.full(len(some), "d"), np.full(len(some), 7)
    found = split_of(names, scenes, some, {("d", 7): frames, ("d", 8): frames[:1]})
    assert found.tolist() == [expected[i] for i in some.tolist()]


def test_an_image_without_ground_truth_is_in_no_split() -> None:
    with pytest.raises(MismatchError, match="d, scene 7: image 12 has no ground truth"):
        split_of(np.array(["d"]), np.array([7]), np.array([12]), {("d", 7): np.arange(10)})


def test_the_published_images_are_split_evenly(data_dir: object) -> None:
    from graspcast.paper.dataset import Published

    data = Published(data_dir)  # type: ignore[arg-type]
    frames = frames_of({name: bop.ground_truth for name, bop in data.bop.items()})
    splits = []
    for (name, scene), images in frames.items():
        n = len(images)
        splits.append(split_of(np.full(n, name), np.full(n, scene), images, frames))
    counts = dict(zip(*np.unique(np.concatenate(splits), return_counts=True), strict=True))
    total = sum(counts.values())
    assert set(counts) == set(SPLITS)
    assert all(abs(count / total - 1 / 3) < 0.03 for count in counts.values())
