"""The networks: moments of coordinate maps, and separate outputs for separate objects."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")

from graspcast.training.networks import CELLS, NETWORKS, _moments  # noqa: E402
from poses import random_poses  # noqa: E402


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
