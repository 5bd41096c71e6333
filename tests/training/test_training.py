"""Training: what the losses count as right is what the estimators read as the true pose."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))
torch = pytest.importorskip("torch", reason="PyTorch is not installed (extra train)")

from graspcast.bop.models import ModelInfo  # noqa: E402
from graspcast.perception.crops import Crop  # noqa: E402
from graspcast.perception.dense import expected_coordinates  # noqa: E402
from graspcast.perception.keypoints import heat_map_peaks  # noqa: E402
from graspcast.pose.transforms import rotation_from_vector, transform  # noqa: E402
from graspcast.rendering.synthetic.camera import INTRINSICS as K  # noqa: E402
from graspcast.rendering.synthetic.tabletop import ColouredMesh  # noqa: E402
from poses import random_poses  # noqa: E402
from training.crops import CELLS as STORED  # noqa: E402
from training.crops import PIXELS as STORED_PIXELS  # noqa: E402
from training.crops import Objects  # noqa: E402
from training.losses import LOSSES, Geometry  # noqa: E402
from training.networks import BINS, CELLS, HEAT_CELLS, NETWORKS, _moments  # noqa: E402
from training.samples import make_batch  # noqa: E402

SIZE = np.array([0.08, 0.06, 0.16])


class Boxes:
    """Stands for a directory of models: boxes, the second with a half turn about z."""

    def __init__(self) -> None:
        turn = transform(rotation_from_vector(np.array([0, 0, np.pi])), np.zeros(3))
        self.info = {
            1: ModelInfo(1, float(np.linalg.norm(SIZE)), -SIZE / 2, SIZE, np.zeros((0, 4, 4))),
            5: ModelInfo(5, float(np.linalg.norm(SIZE)), -SIZE / 2, SIZE, turn[None]),
        }

    def __getitem__(self, obj_id: int) -> ModelInfo:
        return self.info[obj_id]


@pytest.fixture(scope="module")
def objects() -> Objects:
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.5, 0.5, (400, 3)) * SIZE
    mesh = ColouredMesh(points, np.zeros((0, 3), dtype=np.int64), np.zeros((400, 3), np.uint8))
    return Objects((1, 5), {1: mesh, 5: mesh}, Boxes())  # type: ignore[arg-type]


def raw(n: int = 16) -> dict[str, object]:
    """Stored crops as rendering makes them, of noise."""
    rng = np.random.default_rng(1)
    poses = random_poses(n, 2, depth_m=0.8)
    pixels = poses[:, :3, 3] @ K.T
    crop = np.column_stack([pixels[:, :2] / pixels[:, 2:], rng.uniform(150, 250, n)])
    return {
        "image": torch.from_numpy(
            rng.integers(0, 256, (n, STORED_PIXELS, STORED_PIXELS, 3), dtype=np.uint8)
        ),
        "coordinates": torch.from_numpy(
            rng.integers(0, 256, (n, STORED, STORED, 3), dtype=np.uint8)
        ),
        "mask": torch.from_numpy(rng.random((n, STORED, STORED)) < 0.5),
        "object": torch.arange(n) % 2,
        "cam_T_obj": torch.from_numpy(poses),
        "crop": torch.from_numpy(crop),
    }


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def test_terms_are_those_that_the_estimators_undo(objects: Objects) -> None:
    # Without jitter no turn of the crop: numbers for numbers what perception.crops says.
    batch = make_batch(raw(), objects, None)
    for k in range(len(batch.obj)):
        crop = Crop(*batch.crop[k].double().tolist())
        pose = raw()["cam_T_obj"][k].numpy()  # type: ignore[index]
        rotation, site = crop.encode_pose(pose, K, float(np.linalg.norm(SIZE)))
        np.testing.assert_allclose(batch.rotation[k], rotation, atol=1e-5)
        np.testing.assert_allclose(batch.site[k], site, atol=1e-4)


def test_a_jittered_crop_is_turned_about_its_ray(objects: Objects) -> None:
    # Points projected through the turned crop are where the allocentric terms put them.
    batch = make_batch(raw(), objects, generator())
    points = torch.randn(len(batch.obj), 5, 3, generator=generator()) * 0.02
    place = batch.project(points)
    ray = points @ batch.rotation.mT
    z = torch.exp(batch.site[:, 2]) * K[0, 0] * float(np.linalg.norm(SIZE)) / batch.crop[:, 2]
    scale = K[0, 0] / z / batch.crop[:, 2]
    expected = batch.site[:, None, :2] + ray[..., :2] * scale[:, None, None]
    # To first order in the size over the distance.
    assert (place - expected).abs().max() < 0.03


def said(batch: object, geometry: Geometry, name: str, s: int = 0) -> object:
    """What a network would say that knew the truth, turned by symmetry ``s``."""
    symmetry = geometry.symmetries[batch.obj, s]  # type: ignore[attr-defined]
    if name == "keypoints":
        points = geometry.keypoints[batch.obj] @ symmetry[:, :3, :3].mT  # type: ignore
        place = (batch.project(points) + 0.5) * HEAT_CELLS - 0.5  # type: ignore[attr-defined]
        apart = (torch.arange(HEAT_CELLS) - place[..., None]) ** 2
        return -0.5 * (apart[:, :, 0, None, :] + apart[:, :, 1, :, None])
    place = _turned(batch, geometry, symmetry) * (BINS - 1)
    bins = torch.arange(BINS)[None, None, :, None, None]
    logits = torch.log((1 - (place[:, :, None] - bins).abs()).clamp(min=1e-6))
    mask = torch.where(batch.mask, 9.0, -9.0)[:, None]  # type: ignore[attr-defined]
    drawn = torch.cat([logits.flatten(1, 2), mask], dim=1)
    if name == "dense":
        return drawn
    true = batch.rotation @ symmetry[:, :3, :3]  # type: ignore[attr-defined]
    return torch.cat([true[:, 0], true[:, 1], batch.site], dim=1), drawn  # type: ignore


def _turned(batch: object, geometry: Geometry, symmetry: object) -> object:
    coordinates = batch.coordinates.flatten(2) - 0.5  # type: ignore[attr-defined]
    size = geometry.size[batch.obj][..., None]  # type: ignore[attr-defined]
    turned = symmetry[:, :3, :3] @ (coordinates * size) / size + 0.5  # type: ignore[index]
    return turned.clamp(0, 1).unflatten(2, (CELLS, CELLS))


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_the_truth_and_its_symmetric_twin_are_equally_right(name: str, objects: Objects) -> None:
    geometry = Geometry.of(objects)
    batch = make_batch(raw(), objects, generator())
    right = LOSSES[name](said(batch, geometry, name), batch, geometry)
    twin = LOSSES[name](said(batch, geometry, name, s=1), batch, geometry)
    torch.testing.assert_close(right, twin, atol=2e-2, rtol=0.0)
    # The first object has no symmetry: for it the half turn is an error.
    geometry.symmetries[:] = torch.eye(4)
    assert LOSSES[name](said(batch, Geometry.of(objects), name, s=1), batch, geometry) > right + 0.1


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_what_is_right_is_the_minimum(name: str, objects: Objects) -> None:
    geometry = Geometry.of(objects)
    batch = make_batch(raw(), objects, generator())
    right = said(batch, geometry, name)
    loss = LOSSES[name](right, batch, geometry)
    for seed in range(3):
        noise = torch.Generator().manual_seed(seed)

        def other(tensor: object, noise: object = noise) -> object:
            return tensor + 0.3 * torch.randn(tensor.shape, generator=noise)  # type: ignore

        wrong = tuple(map(other, right)) if isinstance(right, tuple) else other(right)
        assert LOSSES[name](wrong, batch, geometry) > loss


def test_the_estimators_read_what_the_losses_call_right(objects: Objects) -> None:
    geometry = Geometry.of(objects)
    batch = make_batch(raw(), objects, None)
    logits = said(batch, geometry, "dense")[:, :-1]  # type: ignore[index]
    for k in range(4):
        read = expected_coordinates(logits[k].double().numpy().reshape(3, BINS, -1))
        wanted = batch.coordinates[k].flatten(1).numpy()
        np.testing.assert_allclose(read, wanted, atol=2e-3)
    heat = said(batch, geometry, "keypoints")
    place = batch.project(geometry.keypoints[batch.obj])
    for k in range(4):
        found, _ = heat_map_peaks(heat[k].double().numpy())  # type: ignore[index]
        np.testing.assert_allclose(found, place[k], atol=0.2 / HEAT_CELLS)


def test_moments_are_the_rotation_s_rows_for_an_object_far_away() -> None:
    generator = torch.Generator().manual_seed(0)
    points = 0.3 * torch.randn(4, 3, CELLS, CELLS, generator=generator)
    turn = torch.from_numpy(random_poses(4)[:, :3, :3]).float()
    places = 0.7 * (turn[:, :2] @ points.flatten(2)).unflatten(2, (CELLS, CELLS))
    mask = (torch.rand(4, 1, CELLS, CELLS, generator=generator) < 0.5).float()
    found = _moments(points, places, mask)
    torch.testing.assert_close(found[:, :6], 0.7 * turn[:, :2].flatten(1), atol=0.02, rtol=0.0)
    torch.testing.assert_close(found[:, 12], mask.mean(dim=(1, 2, 3)))


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_a_network_tells_objects_apart_once_it_is_trained(name: str) -> None:
    torch.manual_seed(0)
    network = NETWORKS[name](2).eval()
    image = torch.rand(1, 3, 64, 64)
    one, other = (network(image, torch.tensor([k])) for k in (0, 1))
    first, second = (x[0] if isinstance(x, tuple) else x for x in (one, other))
    assert (first - second).abs().max() > 1e-3
    assert torch.isfinite(first).all()
