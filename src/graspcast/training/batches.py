"""Training batches: stored crops with jitter and image augmentation, as tensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy import ndarray
from torch import Tensor
from torch.nn import functional as F

from graspcast.perception.crops import MARGIN
from graspcast.rendering.synthetic.camera import INTRINSICS
from graspcast.training.networks import CELLS, PIXELS
from graspcast.training.objects import Objects
from graspcast.training.samples import STORED_MARGIN

__all__ = ["Batch", "make_batch"]


@dataclass
class Batch:
    """A batch of crops with ground truth.

    Attributes
    ----------
    image, obj
        Crops, (b, 3, PIXELS, PIXELS) in [0, 1]; indices of the trained objects, (b,).
    coordinates, mask
        Object coordinates of each cell, from 0 to 1 in the box; whether the cell shows the object.
    rotation, site
        Allocentric rotation and SITE, as in graspcast.perception.crops.
    cam_R, translation
        The true pose, metres.
    crop, turn
        Centre and side of the crop in the image, and its in-plane rotation, (b, 2, 2).
    """

    image: Tensor
    obj: Tensor
    coordinates: Tensor
    mask: Tensor
    rotation: Tensor
    site: Tensor
    translation: Tensor
    crop: Tensor
    turn: Tensor
    cam_R: Tensor

    def project(self, points: Tensor) -> Tensor:
        """Project points in the object's frame to the crop, (b, k, 3) to (b, k, 2)."""
        K = torch.tensor(INTRINSICS, dtype=torch.float32, device=points.device)
        pixel = (points @ self.cam_R.mT + self.translation[:, None]) @ K.T
        pixel = pixel[..., :2] / pixel[..., 2:]
        return ((pixel - self.crop[:, None, :2]) / self.crop[:, None, 2:]) @ self.turn.mT

    def to(self, device: str) -> Batch:
        """Return the batch on a device, images in the memory format of convolutions there."""
        moved = {f.name: getattr(self, f.name).to(device) for f in fields(self)}
        moved["image"] = moved["image"].contiguous(memory_format=torch.channels_last)
        return Batch(**moved)


def _ray_rotation(crop: Tensor) -> Tensor:
    K = torch.tensor(INTRINSICS, dtype=torch.float32)
    ray = torch.stack([(crop[:, 0] - K[0, 2]) / K[0, 0], (crop[:, 1] - K[1, 2]) / K[1, 1]], dim=1)
    a, b, c = F.normalize(F.pad(ray, (0, 1), value=1.0), dim=1).unbind(1)
    rows = [
        [1 - a * a / (1 + c), -a * b / (1 + c), a],
        [-a * b / (1 + c), 1 - b * b / (1 + c), b],
        [-a, -b, c],
    ]
    return torch.stack([torch.stack(row, 1) for row in rows], 1)


def make_batch(
    stored_crops: Mapping[str, ndarray],
    objects: Objects,
    random: torch.Generator | None,
    strength: float = 1.0,
) -> Batch:
    """Make a batch on the CPU; with a random generator, jitter the crops and augment the images.

    Parameters
    ----------
    stored_crops
        Columns of some samples, as :meth:`graspcast.training.samples.Samples.take` returns them.
    objects
        The objects.
    random
        The random generator; None for crops and images as they are stored.
    strength
        Strength of turns and of augmentation; 1 for photographs.
    """
    raw = {name: torch.from_numpy(np.ascontiguousarray(v)) for name, v in stored_crops.items()}
    n = len(raw["object"])
    stored = raw["crop"].float()
    zero = torch.zeros(n)
    log_scale, angle, shift = zero, zero, torch.zeros(n, 2)
    if random is not None:
        log_scale = (0.07 * torch.randn(n, generator=random)).clamp(-0.2, 0.2)
        shift = (0.05 * torch.randn(n, 2, generator=random)).clamp(-0.15, 0.15) / STORED_MARGIN
        angle = (torch.rand(n, generator=random) - 0.5) * 0.7 * strength
    ratio = MARGIN / STORED_MARGIN * torch.exp(log_scale)
    cosine, sine = torch.cos(angle), torch.sin(angle)
    rotate = torch.stack([torch.stack([cosine, -sine], 1), torch.stack([sine, cosine], 1)], 1)
    theta = torch.cat([ratio[:, None, None] * rotate, 2 * shift[..., None]], dim=2)
    image = raw["image"].permute(0, 3, 1, 2).float() / 255
    image = F.grid_sample(
        image,
        F.affine_grid(theta, [n, 3, PIXELS, PIXELS], align_corners=False),
        align_corners=False,
    )
    cells = torch.cat([raw["coordinates"].float() / 255, raw["mask"][..., None].float()], dim=-1)
    cells = F.grid_sample(
        cells.permute(0, 3, 1, 2),
        F.affine_grid(theta, [n, 4, CELLS, CELLS], align_corners=False),
        mode="nearest",
        align_corners=False,
    )
    crop = torch.cat([stored[:, :2] + stored[:, 2:] * shift, (stored[:, 2] * ratio)[:, None]], 1)
    pose = raw["cam_T_obj"].float()
    K = torch.tensor(INTRINSICS, dtype=torch.float32)
    spin = torch.zeros(n, 3, 3)
    spin[:, :2, :2], spin[:, 2, 2] = rotate.mT, 1.0
    crop_T_cam = spin @ _ray_rotation(crop).mT
    pixel = pose[:, :3, 3] @ K.T
    z = pixel[:, 2]
    place = (pixel[:, :2] / z[:, None] - crop[:, :2]) / crop[:, 2:]
    place = (rotate.mT @ place[..., None])[..., 0]
    diameter = torch.tensor([objects.models[k].diameter_m for k in objects.ids])
    scale = torch.log(z * crop[:, 2] / (K[0, 0] * diameter[raw["object"]]))
    mask = cells[:, 3] > 0.5
    if random is not None:
        image, mask = _augment(image, mask, random, strength)
    return Batch(
        image=image,
        obj=raw["object"],
        coordinates=cells[:, :3],
        mask=mask,
        rotation=crop_T_cam @ pose[:, :3, :3],
        site=torch.cat([place, scale[:, None].float()], 1),
        translation=pose[:, :3, 3],
        crop=crop,
        turn=rotate.mT,
        cam_R=pose[:, :3, :3],
    )


def _augment(
    image: Tensor, mask: Tensor, random: torch.Generator, strength: float
) -> tuple[Tensor, Tensor]:
    """Augment images with gain, gamma, blur, noise and occlusion."""
    n = len(image)

    def uniform(low: float, high: float, *shape: int) -> Tensor:
        return low + (high - low) * torch.rand(n, *shape, generator=random)

    if torch.rand((), generator=random) < 0.5:
        mild = F.avg_pool2d(F.pad(image, (1, 1, 1, 1), mode="replicate"), 3, 1)
        image = image + uniform(0, 1, 1, 1, 1) * (mild - image)
    left, top = uniform(-0.2, 1, 1, 1), uniform(-0.2, 1, 1, 1)
    wide, high = uniform(0.1, 0.5, 1, 1), uniform(0.1, 0.5, 1, 1)

    def covered(cells: int) -> Tensor:
        axis = (torch.arange(cells) + 0.5) / cells
        x, y = axis[None, None, :], axis[None, :, None]
        return ((x - left).abs() < wide / 2) & ((y - top).abs() < high / 2) & there

    there = uniform(0, 1, 1, 1) < 0.3 * strength
    image = torch.where(covered(PIXELS)[:, None], uniform(0, 1, 3, 1, 1), image)
    mask = mask & ~covered(CELLS)
    image = image * torch.exp(strength * uniform(-0.45, 0.45, 1, 1, 1))
    image = image * torch.exp(strength * uniform(-0.12, 0.12, 3, 1, 1))
    image = image.clamp(1e-4, 1) ** torch.exp(strength * uniform(-0.35, 0.35, 1, 1, 1))
    image = image + strength * uniform(0, 0.04, 1, 1, 1) * torch.randn(
        image.shape, generator=random
    )
    return image.clamp(0, 1), mask
