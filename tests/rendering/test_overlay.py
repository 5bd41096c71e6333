"""Overlays: what is drawn where, how far off it is said to be, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.ndimage import binary_dilation, binary_erosion
from scipy.spatial import Delaunay

from bop_images import IMAGES, write_dataset
from commands import refused
from graspcast.bop.dataset import BopDataset
from graspcast.bop.meshes import Mesh
from graspcast.bop.results import Results, read_results, write_results
from graspcast.cli import main
from graspcast.errors import InputError, MismatchError
from graspcast.estimates.instances import InstanceKey
from graspcast.forecasting.verdict import VerdictRow, decide, write_verdicts
from graspcast.pose.transforms import rotation_from_vector, transform, transform_points
from graspcast.rendering.drawing import BAD, GOOD
from graspcast.rendering.overlay import draw_overlay
from graspcast.rendering.overlay_sheet import overlay_sheet, overlays
from poses import nudged

SIDE = 128
K = np.array([[150.0, 0, 63.5], [0, 150.0, 63.5], [0, 0, 1.0]])
FAR_OFF = transform(np.eye(3), np.array([0.02, 0.03, 0.0]))


def written(pixels: np.ndarray, colour: tuple[int, int, int]) -> int:
    """How many pixels are nearly of the colour of an ink."""
    return int((np.abs(pixels.astype(int) - colour).max(axis=-1) < 45).sum())


def cube() -> tuple[Mesh, np.ndarray]:
    made = trimesh.creation.box(extents=(0.1, 0.08, 0.12))
    mesh = Mesh(np.asarray(made.vertices), np.asarray(made.faces))
    return mesh, np.tile(np.array([220, 40, 40], dtype=np.uint8), (len(mesh.vertices), 1))


def noise(height: int = SIDE, width: int = SIDE) -> np.ndarray:
    return np.random.default_rng(0).integers(60, 120, (height, width, 3), dtype=np.uint8)


def near(x: float = 0.0, y: float = 0.0, z: float = 0.2) -> np.ndarray:
    """So near that the whole image is in the picture, at its own scale."""
    return transform(rotation_from_vector(np.array([0.5, 0.7, 0.2])), np.array([x, y, z]))


def inside(mesh: Mesh, cam_T_obj: np.ndarray, intrinsics: np.ndarray = K) -> np.ndarray:
    """The pixels in the convex hull of the projected vertices."""
    pixels = transform_points(cam_T_obj, mesh.vertices) @ intrinsics.T
    hull = Delaunay(pixels[:, :2] / pixels[:, 2:])
    v, u = np.mgrid[:SIDE, :SIDE]
    return (hull.find_simplex(np.stack([u, v], axis=-1).reshape(-1, 2)) >= 0).reshape(SIDE, SIDE)


def test_the_estimate_is_green_and_the_rest_is_the_image() -> None:
    (mesh, colours), image = cube(), noise()
    out = draw_overlay(image, K, mesh, colours, near(), size=SIDE)
    covered = inside(mesh, near())
    assert 3000 < covered.sum() < 12000
    well, around = binary_erosion(covered, iterations=2), binary_dilation(covered, iterations=4)
    np.testing.assert_array_equal(out[~around], image[~around])
    green = (out[..., 1] > out[..., 0] + 20) & (out[..., 1] > out[..., 2] + 20)
    assert green[well].mean() > 0.85
    # Translucent: the noise is seen through it.
    assert np.corrcoef(out[well][:, 0], image[well][:, 0])[0, 1] > 0.3
    outline = binary_dilation(covered, iterations=2) & ~covered
    assert out[outline].astype(int)[:, 1].mean() > 150


def test_the_true_pose_is_solid_and_in_its_colours() -> None:
    (mesh, colours), image = cube(), noise()
    true, est = near(-0.02), near(0.02, 0.01)
    out = draw_overlay(image, K, mesh, colours, est, true, size=SIDE)
    alone = inside(mesh, true) & ~binary_dilation(inside(mesh, est), iterations=4)
    alone = binary_erosion(alone, iterations=2)
    assert alone.sum() > 100
    assert (out[alone].astype(int)[:, 0] > 2 * out[alone][:, 1]).all()
    both = binary_erosion(inside(mesh, true) & inside(mesh, est), iterations=3)
    plain = draw_overlay(image, K, mesh, colours, est, size=SIDE)
    # The true one hides the image behind it, and shines through the estimate.
    assert out[both][:, 0].astype(int).mean() > plain[both][:, 0].astype(int).mean() + 20
    assert out[both].astype(int)[:, 1].mean() > 60


def gradient(height: int, width: int) -> np.ndarray:
    """Red tells the column and green the row, in shares of 255."""
    v, u = np.mgrid[:height, :width] + 0.5
    return np.rint(np.stack([255 * u / width, 255 * v / height, 0 * u], axis=-1)).astype(np.uint8)


@pytest.mark.parametrize(("height", "width"), [(480, 640), (640, 480)])
@pytest.mark.parametrize("at", [(0.0, 0.0), (0.3, 0.25), (-0.34, -0.28)])
def test_the_picture_is_a_square_about_both(
    height: int, width: int, at: tuple[float, float]
) -> None:
    mesh, colours = cube()
    colours[:] = [0, 0, 250]
    intrinsics = np.array([[600.0, 0, width / 2], [0, 600.0, height / 2], [0, 0, 1]])
    pose = transform(np.eye(3), np.array([*at, 0.8]))
    poses = pose, pose @ FAR_OFF
    out = draw_overlay(gradient(height, width), intrinsics, mesh, colours, *poses, size=200)
    size = np.array([width, height])
    low, high = out[0, 0, :2] / 255 * size, out[-1, -1, :2] / 255 * size
    # As wide as high, and the least of it: a byte tells the place to three pixels.
    assert high - low == pytest.approx(np.full(2, (high - low).mean()), abs=4)
    corners = [transform_points(p, mesh.vertices) @ intrinsics.T for p in poses]
    seen = [np.clip(c[:, :2] / c[:, 2:], 0, size) for c in corners]
    both = np.concatenate(seen)
    assert (both > low - 3).all() and (both < high + 3).all()
    assert (high - low).max() < 1.4 * np.ptp(both, axis=0).max()
    green = np.argwhere((out[..., 1] > 200) & (out[..., 0] < 60))[:, ::-1]
    drawn = low + green / 200 * (high - low)
    compared = 0
    for end in (np.min, np.max):
        there, reached = end(seen[0], axis=0), end(drawn, axis=0)
        # At the image's border there is no outline.
        within = (there > 10) & (there < size - 10)
        assert reached[within] == pytest.approx(there[within], abs=6)
        compared += within.sum()
    assert compared >= 2


def test_beyond_the_image_the_picture_is_white() -> None:
    mesh, colours = cube()
    level = K.copy()
    level[1, 2] = 29.5
    out = draw_overlay(gradient(60, 300), level, mesh, colours, near(0.05, 0.0, 0.35), size=100)
    white = (out == 255).all(axis=-1)
    assert white[:4].all(axis=1).any() and white[-4:].all(axis=1).any()
    assert not white[45:55].any()


def test_wild_estimates_are_drawn_as_far_as_they_are_seen() -> None:
    (mesh, colours), image = cube(), noise(96, 160)
    for pose in (near(z=-0.5), near(5.0), near(z=0.01), near(z=50.0)):
        out = draw_overlay(image, K, mesh, colours, pose, near(z=0.6), size=64)
        assert out.shape == (64, 64, 3)
        assert (out[..., 0] > out[..., 1].astype(int) + 40).any() or np.linalg.norm(pose) < 2


@pytest.fixture
def world(tmp_path: Path) -> Path:
    dataset = write_dataset(tmp_path / "made")
    for seed, name in enumerate("ab"):
        write_results(tmp_path / f"{name}_made-test.csv", _guesses(dataset, seed))
    return tmp_path


def _guesses(dataset: BopDataset, seed: int) -> Results:
    truth = dataset.ground_truth
    n = len(truth)
    return Results(
        scene_id=truth.scene_id,
        im_id=truth.im_id,
        obj_id=truth.obj_id,
        score=np.linspace(1, 0.5, n),
        cam_T_obj=nudged(truth.cam_T_obj, seed),
        time_s=np.full(n, -1.0),
        line=np.arange(n),
    )


def command(world: Path, *more: str, names: str = "a") -> list[str]:
    estimates = [f"--estimates={name}={world / f'{name}_made-test.csv'}" for name in names]
    out = ["--bop", str(world / "made"), "--out", str(world / "o.png")]
    return ["overlay", *estimates, *out, *more]


def test_fields_tell_what_the_errors_are(world: Path) -> None:
    dataset = BopDataset(world / "made")
    results = {name: read_results(world / f"{name}_made-test.csv") for name in "ab"}
    fields = overlays(dataset, results, IMAGES, size=64)
    assert [(f.object, f.estimator) for f in fields[:4]] == [
        ("made-1", "a"), ("made-1", "b"), ("made-5", "a"), ("made-5", "b"),
    ]  # fmt: skip
    assert len(fields) == 2 * len(dataset.ground_truth)
    for field in fields:
        table = results[field.estimator]
        keys = (table.scene_id, table.im_id, table.obj_id)
        of = (field.scene_id, field.im_id, int(field.object[-1]))
        (row,) = np.flatnonzero(np.all([k == v for k, v in zip(keys, of, strict=True)], axis=0))
        true, est = dataset.ground_truth.cam_T_obj[row], table.cam_T_obj[row]
        assert field.translation_mm == pytest.approx(1000 * np.linalg.norm((est - true)[:3, 3]))
        cosine = (np.trace(est[:3, :3].T @ true[:3, :3]) - 1) / 2
        assert field.rotation_deg == pytest.approx(np.degrees(np.arccos(cosine)), rel=1e-6)


def test_without_ground_truth_there_is_the_estimate_alone(world: Path) -> None:
    dataset = BopDataset(world / "made")
    results = {"a": read_results(world / "a_made-test.csv")}
    known = overlays(dataset, results, [(1, 3)], size=64)
    for path in (world / "made").glob("test/*/scene_gt.json"):
        path.unlink()
    fields = overlays(BopDataset(world / "made"), results, [(1, 3)], size=64)
    assert [field.rotation_deg for field in fields] == [None, None]
    assert any((a.pixels != b.pixels).any() for a, b in zip(known, fields, strict=True))


def verdict_row(
    scene_id: int, im_id: int, obj_id: int, est_id: int = 0, *, probability: float
) -> VerdictRow:
    key = InstanceKey("made", scene_id, im_id, obj_id, est_id)
    return VerdictRow(key, "a", "parallel", decide(probability, 0.5), np.eye(4))


def test_several_of_an_object_and_verdicts_on_each(world: Path) -> None:
    dataset = BopDataset(world / "made")
    table = read_results(world / "a_made-test.csv").select(np.array([0, 0]))
    shifted = table.cam_T_obj.copy()
    shifted[1, :3, 3] += [0.05, 0.0, 0.0]
    # The second row of the file has the higher score, so it is instance 0.
    table = replace(table, cam_T_obj=shifted, score=np.array([0.2, 0.9]))
    one = replace(table.select(np.array([1])), score=np.array([0.7]))
    verdicts = [verdict_row(1, 3, 1, 1, probability=0.2), verdict_row(1, 3, 1, 0, probability=0.9)]
    fields = overlays(dataset, {"a": table, "b": one}, [(1, 3)], verdicts=verdicts, size=64)
    assert [field.pixels is None for field in fields] == [False, False, False, True]
    told = [[row.verdict.attempt for row in field.verdicts] for field in fields]
    assert told == [[True], [], [False], []]
    # The one true object belongs to the nearer of two estimates, or to the only one.
    assert [field.rotation_deg is None for field in fields] == [True, False, False, True]
    sheet = np.asarray(overlay_sheet(fields, estimators=2, size=64))
    # Captions that are wider than the pictures keep these apart.
    assert 4 * 64 + 3 * 8 < sheet.shape[1] < 1000
    for colour, half in ((GOOD, 0), (BAD, 1)):
        mine = np.array_split(sheet, 2, axis=1)[half]
        other = np.array_split(sheet, 2, axis=1)[1 - half]
        assert written(mine[64:], colour) > 10 and not written(other[64:], colour)
    missing = "no verdict on made-1 in image 1/3, est_id 1 by a"
    with pytest.raises(InputError, match=missing):
        overlays(dataset, {"a": table}, [(1, 3)], verdicts=verdicts[1:], size=64)
    # The principal's estimates have the verdicts, wherever it stands.
    fields = overlays(dataset, {"b": one, "a": table}, [(1, 3)], verdicts=verdicts, size=64)
    assert [[row.key.est_id for row in field.verdicts] for field in fields] == [[], [0]]
    with pytest.raises(
        MismatchError, match="verdicts are on estimates by a, but the estimates are by b"
    ):
        overlays(dataset, {"b": one}, [(1, 3)], verdicts=verdicts, size=64)


def test_the_verb_writes_a_sheet(world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        verdict_row(scene, image, obj_id, probability=0.7)
        for scene, image in IMAGES
        for obj_id in (1, 5)
    ]
    write_verdicts(world / "v.csv", rows)
    more = ["--image", "1/3", "--image", "2/3", "--size", "80", "--verdicts", str(world / "v.csv")]
    assert main(command(world, *more, names="ab")) == 0
    assert capsys.readouterr().out.strip() == str(world / "o.png")
    with Image.open(world / "o.png") as image:
        assert image.width > 4 * 80 + 3 * 8
        assert 2 * 80 < image.height < 4 * 80
        assert written(np.asarray(image)[80:130], GOOD) > 10
    assert main(command(world, "--image", "1/3", "--objects", "made-5", "--size", "80")) == 0
    with Image.open(world / "o.png") as image:
        assert 80 <= image.width < 200


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--image", "7/1"], "no estimate of made in image 7/1; it has one in 1/3, 1/8, 2/3"),
        (
            ["--image", "1/3", "--objects", "7"],
            "unknown object 'made-7' (did you mean 'made-5'?); known: made-1, made-5",
        ),
        (["--image", "1/3", "--objects", "lmo-5"], "unknown object 'lmo-5'"),
        (["--image", "1/3", "--verdicts", "none.csv"], "none.csv: cannot be read"),
        (["--image", "1/3", "--out", "o.jpg"], "drawn to .png"),
    ],
)
def test_what_cannot_be_drawn_is_said(
    world: Path, more: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert says in refused(command(world, *more), capsys)
    assert not (world / "o.png").exists()


def test_estimates_of_other_images_verdicts_and_points_are_refused(
    world: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_verdicts(world / "v.csv", [verdict_row(9, 9, 1, probability=0.7)])
    asked = command(world, "--image", "1/3", "--verdicts", str(world / "v.csv"))
    assert "no verdict on made-1 in image 1/3, est_id 0 by a" in refused(asked, capsys)
    (world / "made" / "test" / "000001" / "rgb" / "000003.png").unlink()
    assert "no image 1/3" in refused(command(world, "--image", "1/3"), capsys)
    path = world / "made" / "models" / "obj_000001.ply"
    text = path.read_text().replace("element face 2", "element face 0")
    path.write_text(text.replace("3 0 1 2\n3 1 3 2\n", ""))
    said = refused(command(world, "--image", "2/3"), capsys)
    assert "obj_000001.ply: has no faces" in said
    assert not (world / "o.png").exists()


def test_real_images_of_lmo(data_dir: Path, tmp_path: Path) -> None:
    published = data_dir / "published" / "lmo"
    names = {"epos": "epos_lmo-test.csv", "zebrapose": "zebrapose_lmo-test.csv"}
    estimates = [f"--estimates={name}={published / file}" for name, file in names.items()]
    out = ["--size", "200", "--out", str(tmp_path / "o.png")]
    bop = ["--bop", str(data_dir / "bop" / "lmo"), "--image", "2/3", "--objects", "5"]
    assert main(["overlay", *estimates, *bop, *out]) == 0
    with Image.open(tmp_path / "o.png") as image:
        assert image.width == 2 * 200 + 8
