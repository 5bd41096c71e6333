"""Batches: crops with jitter, and the true poses as the estimators decode them."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")

from graspcast.perception.crops import Crop  # noqa: E402
from graspcast.rendering.synthetic.camera import INTRINSICS as K  # noqa: E402
from graspcast.training.batches import make_batch  # noqa: E402
from stored_crops import DIAMETER_M, boxes, raw  # noqa: E402


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def test_terms_are_those_that_the_estimators_undo() -> None:
    # Without jitter no turn of the crop: numbers for numbers what perception.crops says.
    batch = make_batch(raw(), boxes(), None)
    for k in range(len(batch.obj)):
        crop = Crop(*batch.crop[k].double().tolist())
        pose = raw()["cam_T_obj"][k]
        rotation, site = crop.encode_pose(pose, K, DIAMETER_M)
        np.testing.assert_allclose(batch.rotation[k], rotation, atol=1e-5)
        np.testing.assert_allclose(batch.site[k], site, atol=1e-4)


def test_a_jittered_crop_is_turned_about_its_ray() -> None:
    # Points projected through the turned crop are where the allocentric terms put them.
    batch = make_batch(raw(), boxes(), generator())
    points = torch.randn(len(batch.obj), 5, 3, generator=generator()) * 0.02
    place = batch.project(points)
    ray = points @ batch.rotation.mT
    z = torch.exp(batch.site[:, 2]) * K[0, 0] * DIAMETER_M / batch.crop[:, 2]
    scale = K[0, 0] / z / batch.crop[:, 2]
    expected = batch.site[:, None, :2] + ray[..., :2] * scale[:, None, None]
    # To first order in the size over the distance.
    assert (place - expected).abs().max() < 0.03


def test_augmented_images_are_images_and_the_same_for_the_same_seed() -> None:
    one, other = (make_batch(raw(), boxes(), generator(), 1.0) for _ in range(2))
    assert torch.equal(one.image, other.image)
    assert one.image.min() >= 0 and one.image.max() <= 1
    plain = make_batch(raw(), boxes(), None)
    assert not torch.equal(one.image, plain.image)


def test_a_batch_on_a_device_is_the_same() -> None:
    batch = make_batch(raw(), boxes(), None)
    moved = batch.to("cpu")
    assert torch.equal(batch.image, moved.image) and torch.equal(batch.site, moved.site)
