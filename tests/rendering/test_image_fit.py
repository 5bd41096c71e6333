"""Image fit: best at the true pose, worse away from it or behind an occluder; what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from bop_images import estimates_of, write_dataset
from graspcast.bop.dataset import BopDataset
from graspcast.bop.meshes import Mesh
from graspcast.errors import InputError, MismatchError, UnknownNameError
from graspcast.estimates.alignment import align
from graspcast.estimates.instances import InstanceKey, Instances
from graspcast.pose.transforms import rotation_from_vector, transform
from graspcast.rendering.image_fit import (
    FIT_COLUMNS,
    ImageFit,
    describe_fit,
    fit_of_instances,
    image_fit,
    with_image_fit,
)
from graspcast.rendering.rasterizer import Canvas

K = np.array([[400.0, 0, 119.5], [0, 400.0, 99.5], [0, 0, 1.0]])
TURN = rotation_from_vector(np.array([0.4, 0.7, 0.2]))
RISES = ("fit_orientation", "fit_weakest", "fit_step", "fit_support")


def brick() -> Mesh:
    made = trimesh.creation.box(extents=(0.1, 0.07, 0.05))
    return Mesh(np.asarray(made.vertices), np.asarray(made.faces))


def at(x: float = 0.0, y: float = 0.0, z: float = 0.6) -> np.ndarray:
    return transform(TURN, np.array([x, y, z]))


def photograph(pose: np.ndarray, seed: int = 0) -> np.ndarray:
    """Render a red brick at a pose, on a background of smooth clutter."""
    rng = np.random.default_rng(seed)
    coarse = rng.integers(60, 200, (10, 12, 3)).astype(np.uint8)
    background = coarse.repeat(20, axis=0).repeat(20, axis=1)
    canvas = Canvas(K, 240, 200, background=background)
    vertices = brick().vertices @ pose[:3, :3].T + pose[:3, 3]
    canvas.draw(vertices, brick().faces, (0.9, 0.15, 0.1))
    return canvas.image()


def fits(image: np.ndarray, *poses: np.ndarray) -> ImageFit:
    return image_fit(image, K, [brick()] * len(poses), np.stack(poses))


def column(found: ImageFit, name: str) -> np.ndarray:
    return found.values[:, FIT_COLUMNS.index(name)]


@pytest.mark.parametrize("seed", range(4))
def test_the_fit_is_best_at_the_true_pose_and_falls_with_every_step_away(seed: int) -> None:
    image = photograph(at(), seed)
    # 1.5 mm is a pixel
    found = fits(image, *(at(x=mm / 1e3, y=mm / 2e3) for mm in (0, 3, 6, 12)))
    assert found.problems == ("",) * 4
    for name in RISES:
        values = column(found, name)
        assert values[0] == values.max()
        assert values[0] > values[2] + 0.05
    assert column(found, "fit_offset").argmin() == 0
    assert column(found, "fit_shift")[0] < column(found, "fit_shift")[1]


def test_a_turned_pose_fits_worse() -> None:
    turned = at()
    turned[:3, :3] = TURN @ rotation_from_vector(np.array([0.0, 0.0, 0.6]))
    found = fits(photograph(at()), at(), turned)
    for name in RISES:
        assert np.diff(column(found, name)) < -0.05


def test_the_scale_tells_nearer_from_farther() -> None:
    farther, true, nearer = fits(photograph(at()), at(z=0.63), at(), at(z=0.575)).values[
        :, FIT_COLUMNS.index("fit_scale")
    ]
    assert farther > true + 0.01
    assert nearer < true - 0.01


def test_an_occluder_lowers_the_weakest_sector_most() -> None:
    image = photograph(at())
    hidden = image.copy()
    hidden[:, 125:] = (40, 90, 200)
    seen, behind = fits(image, at()).values[0], fits(hidden, at()).values[0]
    drop = seen - behind
    weakest, mean = (drop[FIT_COLUMNS.index(name)] for name in ("fit_weakest", "fit_orientation"))
    assert weakest > mean > 0.05


def test_an_object_partly_outside_the_image_is_judged_by_the_rest() -> None:
    pose = at(x=-0.19)
    found = fits(photograph(pose), pose, at(x=-0.19 + 0.012))
    assert found.problems == ("", "")
    assert 0.1 < column(found, "fit_inside")[0] < 0.9
    assert column(found, "fit_orientation")[0] > 0.9
    assert np.diff(column(found, "fit_orientation")) < -0.05


def test_what_has_no_fit_is_nan_and_told_and_others_are_not_affected() -> None:
    image = photograph(at())
    found = fits(image, at(z=-0.6), at(), at(x=5.0), np.full((4, 4), np.nan), at(z=18.0))
    assert np.isnan(found.values).all(axis=1).tolist() == [True, False, True, True, True]
    assert "behind the camera" in found.problems[0]
    assert "outside the image" in found.problems[2]
    assert "not finite" in found.problems[3]
    assert "too few" in found.problems[4]
    np.testing.assert_array_equal(found.values[1], fits(image, at()).values[0])


def test_grey_images_are_judged_by_lightness() -> None:
    image = photograph(at())
    grey = image.mean(axis=2).astype(np.uint8)
    found = image_fit(grey, K, [brick()], at()[None])
    assert found.problems == ("",)
    for other in (grey[..., None], grey[..., None].repeat(3, axis=2)):
        np.testing.assert_array_equal(
            image_fit(other, K, [brick()], at()[None]).values, found.values
        )


def test_an_image_of_one_colour_shows_nothing() -> None:
    for value in (0, 255):
        found = fits(np.full((200, 240, 3), value, np.uint8), at(), at(0.02))
        assert np.isnan(found.values).all()
        assert found.problems == ("the image has one colour throughout",) * 2


def test_nothing_is_divided_by_where_the_outline_has_no_edges() -> None:
    image = np.zeros((200, 240, 3), np.uint8)
    image[0, 0] = 255
    values = fits(image, at()).values[0]
    assert np.isfinite(values).all()
    named = dict(zip(FIT_COLUMNS, values.tolist(), strict=True))
    assert named["fit_orientation"] == named["fit_step"] == named["fit_support"] == 0
    assert named["fit_inside"] == 1


def test_it_is_added_to_what_is_known_of_estimates_and_what_lacks_it_is_counted(
    tmp_path: Path,
) -> None:
    dataset = write_dataset(tmp_path / "d")
    given = align({"a": estimates_of(dataset)}, dataset="d")
    notes: list[str] = []
    found = with_image_fit(given, {"d": dataset}, notes)
    assert notes == ["a: image fit of 6 of 6 instances"]
    assert list(found.seen) == ["score", *FIT_COLUMNS]
    direct = fit_of_instances(given.instances, given.of("a"), {"d": dataset})
    for i, name in enumerate(FIT_COLUMNS):
        np.testing.assert_array_equal(found.seen[name], direct.values[None, :, i])
    np.testing.assert_array_equal(found.seen["score"], given.seen["score"])
    kept = found.select(np.array([2, 0]))
    np.testing.assert_array_equal(kept.seen["fit_step"], found.seen["fit_step"][:, [2, 0]])
    # Of the images of scene 2 there is one; of scene 1 none.
    for path in (tmp_path / "d" / "test" / "000001" / "rgb").iterdir():
        path.unlink()
    notes.clear()
    with_image_fit(given, {"d": BopDataset(tmp_path / "d")}, notes)
    assert notes == ["a: image fit of 2 of 6 instances; none of 4: there is no image 1/3, …"]
    (tmp_path / "d" / "test" / "000002" / "rgb" / "000003.png").unlink()
    with pytest.raises(InputError, match=r"no image of any instance, for example: .* 1/3"):
        with_image_fit(given, {"d": BopDataset(tmp_path / "d")}, notes)


@pytest.mark.parametrize("seed", range(30))
def test_numbers_are_finite_and_in_range_or_all_missing_with_a_reason(seed: int) -> None:
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (int(rng.integers(1, 90)), int(rng.integers(1, 90)), 3), np.uint8)
    turn = rotation_from_vector(rng.normal(size=(6, 3)))
    poses = transform(turn, rng.normal(size=(6, 3)) * [0.2, 0.2, 0.6])
    found = image_fit(image, K, [brick()] * 6, poses)
    for values, problem in zip(found.values, found.problems, strict=True):
        assert np.isfinite(values).all() != bool(problem)
        assert np.isnan(values).all() == bool(problem)
        if not problem:
            shares = [0, 1, 2, 4, 5, 9]
            assert ((values[shares] >= 0) & (values[shares] <= 1 + 1e-9)).all()


def test_no_instances_are_no_rows() -> None:
    found = image_fit(photograph(at()), K, [], np.empty((0, 4, 4)))
    assert found.values.shape == (0, len(FIT_COLUMNS))
    assert found.features.names == FIT_COLUMNS


@pytest.mark.ill_typed
@pytest.mark.parametrize(
    ("image", "K_", "poses", "words"),
    [
        (np.zeros((5, 5, 4), np.uint8), K, at()[None], "RGB"),
        (np.zeros((5, 5, 3)), K, at()[None], "float64"),
        (np.zeros((0, 5, 3), np.uint8), K, at()[None], "RGB"),
        (np.zeros((5, 5, 3), np.uint8), -K, at()[None], "focal"),
        (np.zeros((5, 5, 3), np.uint8), K[:2], at()[None], "3x3"),
        (np.zeros((5, 5, 3), np.uint8), K, at(), "one for each mesh"),
    ],
)
def test_what_is_no_image_camera_or_pose_is_refused(
    image: np.ndarray, K_: np.ndarray, poses: np.ndarray, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        image_fit(image, K_, [brick()], poses)


def test_every_number_has_a_unit_and_a_meaning() -> None:
    for name in FIT_COLUMNS:
        unit, meaning = describe_fit(name)
        assert unit in ("1", "px")
        assert len(meaning) > 20
    with pytest.raises(UnknownNameError, match="fit_step"):
        describe_fit("fit_stop")


def test_the_images_of_a_dataset_are_found_by_the_key(tmp_path: Path) -> None:
    dataset = write_dataset(tmp_path)
    truth = dataset.ground_truth
    keys = [
        InstanceKey("d", int(s), int(i), int(o), 0)
        for s, i, o in zip(truth.scene_id, truth.im_id, truth.obj_id, strict=True)
    ]
    keys.append(InstanceKey("d", 99, 1, int(truth.obj_id[0]), 0))
    poses = np.concatenate([truth.cam_T_obj, truth.cam_T_obj[:1]])
    shares: list[float] = []
    found = fit_of_instances(
        Instances.of(keys), poses, {"d": dataset}, progress=lambda share, _: shares.append(share)
    )
    assert found.problems[-1] == "there is no image 99/1"
    for i, key in enumerate(keys[:-1]):
        image = dataset.image(*key.image)
        camera = dataset.camera_of(*key.image)
        alone = image_fit(image, camera.K, [dataset.models.mesh(key.obj_id)], poses[i : i + 1])
        np.testing.assert_array_equal(found.values[i], alone.values[0])
        assert found.problems[i] == alone.problems[0]
    assert shares[-1] == 1
    with pytest.raises(MismatchError, match="no images of dataset d"):
        fit_of_instances(Instances.of(keys), poses, {})
