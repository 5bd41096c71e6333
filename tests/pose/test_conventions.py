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
@pytest.mark.slow
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


def turned(poses: np.ndarray, degrees: float) -> np.ndarray:
    """The same poses, each turned by so much, about its own axis."""
    axes = np.random.default_rng(3).normal(size=(len(poses), 3))
    axes *= np.radians(degrees) / np.linalg.norm(axes, axis=1, keepdims=True)
    return rotated(poses, Rotation.from_rotvec(axes).as_matrix() @ poses[:, :3, :3])


def shifted(poses: np.ndarray, share: float) -> np.ndarray:
    """The same poses, each shifted by this share of its distance."""
    out = poses.copy()
    out[:, 0, 3] += share * np.linalg.norm(poses[:, :3, 3], axis=1)
    return out


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda p: turned(p, 19.5), True),
        (lambda p: turned(p, 20.5), False),
        (lambda p: shifted(p, 0.099), True),
        (lambda p: shifted(p, 0.101), False),
    ],
)
@pytest.mark.parametrize("symmetric", [False, True])
def test_poses_agree_within_twenty_degrees_and_a_tenth_of_the_distance(
    change: object, found: bool, symmetric: bool
) -> None:
    poses = random_poses(30, 5)
    sixth = rotated(np.eye(4)[None], Rotation.from_rotvec([0, 0, np.pi]).as_matrix()[None])
    symmetries = [np.concatenate([np.eye(4)[None], sixth])] * 30 if symmetric else None
    wrong = WRONG["OpenGL"](change(poses))  # type: ignore[operator]
    assert (find_convention(wrong, poses, symmetries) is not None) == found


@pytest.mark.parametrize(("good", "found"), [(0, True), (4, True), (5, False)])
def test_up_to_a_fifth_may_agree_as_they_are(good: int, found: bool) -> None:
    poses = random_poses(20, 5)
    mixed = WRONG["OpenGL"](poses)
    mixed[:good] = poses[:good]
    result = find_convention(mixed, poses)
    assert (result is not None) == found
    assert result is None or (result.before, result.agreeing) == (good, 20 - good)


@pytest.mark.parametrize(("right", "found"), [(9, False), (10, True)])
def test_half_have_to_agree_after_the_change(right: int, found: bool) -> None:
    poses = random_poses(20, 5)
    mixed = shifted(WRONG["OpenGL"](poses), 0.5)
    mixed[:right] = WRONG["OpenGL"](poses)[:right]
    assert (find_convention(mixed, poses) is not None) == found


@pytest.mark.parametrize(("right", "found"), [(4, False), (5, True)])
def test_five_have_to_agree_however_few_there_are(right: int, found: bool) -> None:
    poses = random_poses(6, 5)
    mixed = shifted(WRONG["OpenGL"](poses), 0.5)
    mixed[:right] = WRONG["OpenGL"](poses)[:right]
    assert (find_convention(mixed, poses) is not None) == found


def test_an_estimator_says_which_words_are_its_own() -> None:
    poses = random_poses(20, 5)
    found = find_convention(WRONG["OpenGL"](poses), poses)
    assert found is not None and found.text("mine", "theirs") == (
        "20 of 20 mine agree with theirs when the camera's y and z axes are flipped (0 do as they "
        "are): are they in OpenGL's camera frame (y up, z backwards)?"
    )


@pytest.mark.parametrize(
    ("behind", "total", "words"),
    [
        (1, 5, "obj_T_cam"),
        (4, 4, ""),
        (19, 100, ""),
        (20, 100, "obj_T_cam"),
        (95, 100, "obj_T_cam"),
        (96, 100, "OpenGL"),
    ],
)
def test_how_many_have_to_lie_behind_the_camera(behind: int, total: int, words: str) -> None:
    said = behind_hint(behind, total)
    assert (words in said) if words else said == ""


def test_symmetries_of_a_single_instance_count_too() -> None:
    """Every instance may have an object, and symmetries, of its own."""
    half_turn = np.diag([-1.0, -1, 1, 1])
    poses = random_poses(20, 2)
    symmetries = [np.stack([np.eye(4), half_turn]) for _ in range(19)] + [np.eye(4)[None]]
    turned_over = poses.copy()
    turned_over[:19] = poses[:19] @ half_turn
    found = find_convention(invert(turned_over), poses, symmetries)
    assert found is not None and found.agreeing == 20
    assert find_convention(turned_over, poses, symmetries) is None
