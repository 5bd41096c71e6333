"""Poses in another convention are named, and good ones never are."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from graspcast.bop.dataset import BopDataset
from graspcast.bop.results import read_results
from graspcast.estimates.alignment import align
from graspcast.estimates.matching import true_poses
from graspcast.paper.dataset import Published
from graspcast.pose.conventions import behind_hint, find_convention, find_odd_one
from graspcast.pose.transforms import invert
from poses import nudged, random_poses


def rotated(poses: np.ndarray, R: np.ndarray) -> np.ndarray:
    out = poses.copy()
    out[:, :3, :3] = R
    return out


def misread(poses: np.ndarray, order: list[int]) -> np.ndarray:
    """A quaternion's components, wxyz, in another order, read as wxyz."""
    xyzw = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    wxyz = xyzw[:, [3, 0, 1, 2]][:, order]
    return rotated(poses, Rotation.from_quat(wxyz[:, [1, 2, 3, 0]]).as_matrix())


def small(poses: np.ndarray) -> np.ndarray:
    vectors = np.radians(Rotation.from_matrix(poses[:, :3, :3]).as_rotvec())
    return rotated(poses, Rotation.from_rotvec(vectors).as_matrix())


WRONG = {
    "obj_T_cam": invert,
    "transposed": lambda p: rotated(p, np.swapaxes(p[:, :3, :3], 1, 2)),
    # wxyz written, read as xyzw: the reader takes z for w, w for x, x for y, y for z.
    "wxyz read as xyzw": lambda p: misread(p, [3, 0, 1, 2]),
    "xyzw read as wxyz": lambda p: misread(p, [1, 2, 3, 0]),
    "OpenGL": lambda p: np.diag([1.0, -1, -1, 1]) @ p,
    "PyTorch3D": lambda p: np.diag([-1.0, -1, 1, 1]) @ p,
    "radians read as degrees": small,
}


@pytest.mark.parametrize("words", WRONG)
@pytest.mark.parametrize("n", [6, 60])
def test_each_convention_is_named_and_undone(words: str, n: int) -> None:
    poses = random_poses(n, 5)
    wrong = WRONG[words](nudged(poses, 1))
    found = find_convention(wrong, poses)
    assert found is not None
    assert words in found.convention.question
    assert (found.agreeing, found.compared) == (n, n)
    assert_allclose(found.convention.undo(wrong), nudged(poses, 1), atol=1e-9)
    text = found.text("estimates by b", "ground truth")
    assert text.startswith(f"{n} of {n} estimates by b agree with ground truth when ")


def test_good_bad_few_and_unknown_poses_are_not_accused() -> None:
    poses = random_poses(60, 5)
    assert find_convention(nudged(poses, 1), poses) is None
    assert find_convention(random_poses(60, 6), poses) is None
    assert find_convention(invert(poses[:4]), poses[:4]) is None
    assert find_convention(invert(poses), np.full_like(poses, np.nan)) is None
    known = poses.copy()
    known[:10] = np.nan
    found = find_convention(invert(poses), known)
    assert found is not None and found.compared == 50


def test_an_object_seen_from_one_side_proves_no_other_rotation() -> None:
    tilts = Rotation.from_euler("x", np.linspace(60, 80, 30)[:, None], degrees=True).as_matrix()
    poses = rotated(random_poses(30, 1), tilts)
    assert find_convention(WRONG["transposed"](poses), poses) is None
    assert find_convention(WRONG["obj_T_cam"](poses), poses) is not None


def test_symmetries_are_no_disagreement() -> None:
    half_turn = np.diag([-1.0, -1, 1, 1])
    symmetries = [np.stack([np.eye(4), half_turn])] * 20
    poses = random_poses(20, 2)
    turned = poses @ half_turn
    turned[::3] = poses[::3]
    found = find_convention(invert(turned), poses, symmetries)
    assert found is not None and found.agreeing == 20
    assert find_convention(turned, poses, symmetries) is None


def test_the_odd_one_of_three_is_named_and_of_two_either_may_be() -> None:
    poses = random_poses(12, 3)
    right = [nudged(poses, 1), nudged(poses, 2), nudged(poses, 3)]
    assert find_odd_one("abc", np.stack(right)) == ""
    for odd in range(3):
        mixed = [WRONG["wxyz read as xyzw"](p) if k == odd else p for k, p in enumerate(right)]
        said = find_odd_one("abc", np.stack(mixed))
        assert f" of 12 estimates by {'abc'[odd]} agree" in said
        assert said.endswith("are quaternions wxyz read as xyzw?")
    said = find_odd_one("ab", np.stack([right[0], invert(right[1])]))
    assert "by b agree with those by a when inverted" in said
    assert said.endswith("Or those by a are.")


def test_poses_behind_the_camera_hint_at_its_axes_or_at_the_inverse() -> None:
    assert "OpenGL" in behind_hint(20, 20)
    assert "9 of 20 poses lie behind it: are they obj_T_cam" in behind_hint(9, 20)
    assert behind_hint(1, 20) == behind_hint(2, 2) == ""


@pytest.mark.parametrize("name", ["lmo", pytest.param("ycbv", marks=pytest.mark.slow)])
def test_published_estimators_are_never_accused_and_always_found_out(
    data: Published, name: str
) -> None:
    dataset: BopDataset = data.bop[name]
    names = ("epos", "gdrnpp", "zebrapose")
    tables = {e: read_results(data.results_path(e, name)) for e in names}
    estimates = align(tables, dataset=name)
    poses = {e: estimates.of(e) for e in names}
    poses["truth"] = true_poses(estimates, "gdrnpp", {name: dataset})
    groups = [np.ones(len(estimates), dtype=bool)]
    groups += [estimates.obj_id == number for number in np.unique(estimates.obj_id)]
    blocks = np.array_split(np.unique(estimates.im_id), 40)
    groups += [g & np.isin(estimates.im_id, b) for g in groups[1:] for b in blocks]
    for one in poses:
        for other in poses:
            if one == other:
                continue
            for rows in groups:
                assert find_convention(poses[one][rows], poses[other][rows]) is None
            for words, wrong in WRONG.items():
                if words != "radians read as degrees":  # errors of degrees would be radians
                    with np.errstate(invalid="ignore"):
                        known = np.isfinite(poses[one]).all(axis=(1, 2))
                    found = find_convention(wrong(poses[one][known]), poses[other][known])
                    assert found is not None and words in found.convention.question
