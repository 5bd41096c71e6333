"""Losses: what they count as right is what the estimators read as the true pose."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")

from graspcast.perception.dense import expected_coordinates  # noqa: E402
from graspcast.perception.keypoints import heat_map_peaks  # noqa: E402
from graspcast.training.batches import make_batch  # noqa: E402
from graspcast.training.geometry import Geometry  # noqa: E402
from graspcast.training.losses import LOSSES  # noqa: E402
from graspcast.training.networks import BINS, CELLS, HEAT_CELLS, NETWORKS  # noqa: E402
from stored_crops import boxes, raw  # noqa: E402


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


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
def test_the_truth_and_its_symmetric_twin_are_equally_right(name: str) -> None:
    geometry = Geometry.of(boxes())
    batch = make_batch(raw(), boxes(), generator())
    right = LOSSES[name](said(batch, geometry, name), batch, geometry)
    twin = LOSSES[name](said(batch, geometry, name, s=1), batch, geometry)
    torch.testing.assert_close(right, twin, atol=2e-2, rtol=0.0)
    # The first object has no symmetry: for it the half turn is an error.
    geometry.symmetries[:] = torch.eye(4)
    assert LOSSES[name](said(batch, Geometry.of(boxes()), name, s=1), batch, geometry) > right + 0.1


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_what_is_right_is_the_minimum(name: str) -> None:
    geometry = Geometry.of(boxes())
    batch = make_batch(raw(), boxes(), generator())
    right = said(batch, geometry, name)
    loss = LOSSES[name](right, batch, geometry)
    for seed in range(3):
        noise = torch.Generator().manual_seed(seed)

        def other(tensor: object, noise: object = noise) -> object:
            return tensor + 0.3 * torch.randn(tensor.shape, generator=noise)  # type: ignore

        wrong = tuple(map(other, right)) if isinstance(right, tuple) else other(right)
        assert LOSSES[name](wrong, batch, geometry) > loss


def test_the_estimators_read_what_the_losses_call_right() -> None:
    geometry = Geometry.of(boxes())
    batch = make_batch(raw(), boxes(), None)
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
