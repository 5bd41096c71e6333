"""Checkpoints: what is kept, and what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="needs PyTorch: pip install 'graspcast[train]'")

from graspcast.errors import FormatError, InputError  # noqa: E402
from graspcast.training.batches import Batch, make_batch  # noqa: E402
from graspcast.training.checkpoint import Checkpoint, new_network  # noqa: E402
from graspcast.training.geometry import Geometry  # noqa: E402
from graspcast.training.networks import NETWORKS  # noqa: E402
from stored_crops import boxes, raw  # noqa: E402


@pytest.fixture(scope="module")
def batch() -> Batch:
    return make_batch(raw(), boxes(), None)


@pytest.mark.parametrize("name", sorted(NETWORKS))
def test_a_saved_state_is_the_same_when_it_is_loaded(
    name: str, batch: Batch, tmp_path: Path
) -> None:
    mine = Checkpoint(name, boxes(), tmp_path)
    geometry = Geometry.of(boxes())
    mine.train_on(batch, geometry, 10)
    mine.save()
    other = Checkpoint(name, boxes(), tmp_path)
    assert other.step == 1
    for one in (mine, other):
        one.train_on(batch, geometry, 10)
    assert other.step == 2
    for a, b in zip(mine.network.parameters(), other.network.parameters(), strict=True):
        assert torch.equal(a, b)
    averaged = mine.averaged(boxes()).state_dict()
    for key, value in other.averaged(boxes()).state_dict().items():
        assert torch.equal(value, averaged[key])


def test_the_seed_decides_the_first_weights(tmp_path: Path) -> None:
    def weights(seed: int) -> object:
        network = Checkpoint("dense", boxes(), tmp_path, seed=seed).network
        return torch.cat([p.detach().flatten() for p in network.parameters()])

    assert torch.equal(weights(1), weights(1))  # type: ignore[arg-type]
    assert not torch.equal(weights(1), weights(2))  # type: ignore[arg-type]


def test_the_network_of_direct_knows_the_boxes() -> None:
    geometry = Geometry.of(boxes())
    extent = new_network("direct", boxes()).extent
    torch.testing.assert_close(extent, geometry.size / geometry.diameter[:, None])


def test_another_s_or_a_damaged_checkpoint_is_named(tmp_path: Path) -> None:
    Checkpoint("dense", boxes(), tmp_path).save()
    content = (tmp_path / "dense.pt").read_bytes()
    (tmp_path / "keypoints.pt").write_bytes(content)
    with pytest.raises(FormatError, match=r"keypoints\.pt.*not a checkpoint of keypoints"):
        Checkpoint("keypoints", boxes(), tmp_path)
    (tmp_path / "dense.pt").write_bytes(content[: len(content) // 2])
    with pytest.raises(FormatError, match="delete it to train from the start"):
        Checkpoint("dense", boxes(), tmp_path)


def test_a_loss_that_is_not_finite_is_refused(batch: Batch, tmp_path: Path) -> None:
    mine = Checkpoint("dense", boxes(), tmp_path)
    geometry = Geometry.of(boxes())
    mine.network.head.bias.data[:] = float("nan")
    before = mine.network.trunk.stem[0].weight.clone()
    with pytest.raises(InputError, match="dense: the loss is nan at step 1"):
        mine.train_on(batch, geometry, 10)
    assert torch.equal(before, mine.network.trunk.stem[0].weight) and mine.step == 0
