"""Loss functions of the networks, each the minimum over the object's symmetries."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.nn import functional as F

from graspcast.training.batches import Batch
from graspcast.training.geometry import Geometry
from graspcast.training.networks import BINS, HEAT_CELLS

__all__ = ["LOSSES", "rotation_of"]


def _least(losses: list[Tensor]) -> Tensor:
    """Take the minimum over symmetries for each sample, then the mean over samples."""
    return torch.stack(losses).min(dim=0).values.mean()


def _other_coordinates(batch: Batch, geometry: Geometry, s: int) -> Tensor:
    """Compute the coordinates in the box after applying symmetry ``s`` to the object."""
    low, size = geometry.low[batch.obj][..., None, None], geometry.size[batch.obj][..., None, None]
    symmetry = geometry.symmetries[batch.obj, s]
    points = (batch.coordinates * size + low).flatten(2)
    points = symmetry[:, :3, :3] @ points + symmetry[:, :3, 3:]
    return ((points.unflatten(2, batch.coordinates.shape[2:]) - low) / size).clamp(0, 1)


def dense(output: Tensor, batch: Batch, geometry: Geometry) -> Tensor:
    """Compute the loss of ``dense``: cross-entropy of coordinate bins, and of the mask."""
    return _least(_map_losses(output, batch, geometry)) + _mask_loss(output, batch)


def _mask_loss(output: Tensor, batch: Batch) -> Tensor:
    return F.binary_cross_entropy_with_logits(output[:, -1], batch.mask.float())


def _map_losses(output: Tensor, batch: Batch, geometry: Geometry) -> list[Tensor]:
    """Compute the map's loss for each symmetry and sample; targets are shared by two bins."""
    mask = batch.mask.float()
    logits = output[:, :-1].unflatten(1, (3, BINS)).log_softmax(dim=2)
    amount = mask.sum(dim=(1, 2)).clamp(min=1.0)
    losses = []
    for s in range(geometry.symmetries.shape[1]):
        # The first and the last bin are the box's borders.
        place = _other_coordinates(batch, geometry, s) * (BINS - 1)
        lower = place.floor().clamp(max=BINS - 2)
        share = (place - lower)[:, :, None]
        index = lower.long()[:, :, None]
        terms = (1 - share) * logits.gather(2, index) + share * logits.gather(2, index + 1)
        losses.append(-(terms[:, :, 0].mean(dim=1) * mask).sum(dim=(1, 2)) / amount)
    return losses


def keypoints(output: Tensor, batch: Batch, geometry: Geometry) -> Tensor:
    """Compute the loss of ``keypoints``: cross-entropy to a Gaussian; none outside of the crop."""
    logits = output.flatten(2).log_softmax(dim=2).unflatten(2, (HEAT_CELLS, HEAT_CELLS))
    cells = torch.arange(HEAT_CELLS, dtype=torch.float32, device=output.device)
    losses = []
    for s in range(geometry.symmetries.shape[1]):
        symmetry = geometry.symmetries[batch.obj, s]
        points = geometry.keypoints[batch.obj] @ symmetry[:, :3, :3].mT + symmetry[:, None, :3, 3]
        place = (batch.project(points) + 0.5) * HEAT_CELLS - 0.5
        inside = ((place > -0.5) & (place < HEAT_CELLS - 0.5)).all(dim=2).float()
        bump = torch.exp(-0.5 * (cells - place[..., None]) ** 2)
        bump = bump / bump.sum(dim=-1, keepdim=True).clamp(min=1e-6)
        terms = torch.einsum("bkyx,bkx,bky->bk", logits, bump[:, :, 0], bump[:, :, 1])
        losses.append(-(terms * inside).sum(dim=1) / inside.sum(dim=1).clamp(min=1.0))
    return _least(losses)


def direct(output: tuple[Tensor, Tensor], batch: Batch, geometry: Geometry) -> Tensor:
    """Compute the loss of ``direct``: distance of points, SITE, and the intermediate map."""
    answer, drawn = output
    points = geometry.points[batch.obj] / geometry.diameter[batch.obj, None, None]
    seen = points @ rotation_of(answer[:, :6]).mT
    losses = []
    for s, off in enumerate(_map_losses(drawn, batch, geometry)):
        true = batch.rotation @ geometry.symmetries[batch.obj, s, :3, :3]
        losses.append(6 * (seen - points @ true.mT).abs().mean(dim=(1, 2)) + off)
    site = (answer[:, 6:] - batch.site).abs().mean()
    return _least(losses) + 4 * site + _mask_loss(drawn, batch)


def rotation_of(six: Tensor) -> Tensor:
    """Orthonormalise two rows (Zhou et al., CVPR 2019), (b, 6) to (b, 3, 3)."""
    x = F.normalize(six[:, :3], dim=1)
    y = F.normalize(six[:, 3:] - (x * six[:, 3:]).sum(dim=1, keepdim=True) * x, dim=1)
    return torch.stack([x, y, torch.linalg.cross(x, y)], dim=1)


LOSSES: dict[str, Callable[[Any, Batch, Geometry], Tensor]] = {
    "dense": dense,
    "direct": direct,
    "keypoints": keypoints,
}
"""The loss function of each estimator."""
