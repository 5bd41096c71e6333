"""The three networks; inputs are a crop and the index of the object to find."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional as F

__all__ = ["BINS", "CELLS", "HEAT_CELLS", "KEYPOINTS", "NETWORKS", "PIXELS"]

PIXELS, CELLS, HEAT_CELLS = 64, 16, 32
"""Side of a crop in pixels, of a coordinate map in cells, of a heat map in cells."""
BINS, KEYPOINTS = 16, 12
"""Number of bins of a coordinate, and of keypoints of an object."""

MAP_WIDTH = 40
_WIDTHS = (24, 40, 80, 72)


class Film(nn.Module):
    """Feature-wise linear modulation by object (FiLM; Perez et al., AAAI 2018)."""

    def __init__(self, objects: int, channels: int):
        super().__init__()
        self.table = nn.Embedding(objects, 2 * channels)
        nn.init.zeros_(self.table.weight)

    def forward(self, x: Tensor, obj: Tensor) -> Tensor:
        scale, shift = self.table(obj)[..., None, None].chunk(2, dim=1)
        return x * (1 + scale) + shift


class PerObject(nn.Module):
    """A linear layer over channels with separate weights for each object."""

    def __init__(self, objects: int, channels: int, out: int):
        super().__init__()
        self.weight = nn.Parameter(torch.randn(objects, out, channels) / channels**0.5)
        self.bias = nn.Parameter(torch.zeros(objects, out, 1))

    def forward(self, x: Tensor, obj: Tensor) -> Tensor:
        return torch.matmul(self.weight[obj], x) + self.bias[obj]


def conv(inputs: int, out: int, size: int = 3, stride: int = 1) -> nn.Sequential:
    layer = nn.Conv2d(inputs, out, size, stride, size // 2, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(out), nn.ReLU(inplace=True))


class Residual(nn.Module):
    def __init__(self, channels: int, objects: int):
        super().__init__()
        self.first = conv(channels, channels)
        self.second = nn.Conv2d(channels, channels, 3, 1, 1, bias=False)
        self.norm = nn.BatchNorm2d(channels)
        self.film = Film(objects, channels)

    def forward(self, x: Tensor, obj: Tensor) -> Tensor:
        return F.relu(x + self.film(self.norm(self.second(self.first(x))), obj))


class Trunk(nn.Module):
    """The backbone: features with 32, 16, 8 and 4 cells a side."""

    def __init__(self, objects: int):
        super().__init__()
        a, b, c, d = _WIDTHS
        self.stem = conv(3, a, 5, 2)
        self.down = nn.ModuleList([conv(a, b, 3, 2), conv(b, c, 3, 2), conv(c, d, 3, 2)])
        self.blocks = nn.ModuleList([Residual(n, objects) for n in (b, c, d)])

    def forward(self, image: Tensor, obj: Tensor) -> list[Tensor]:
        out = [self.stem(image)]
        for down, block in zip(self.down, self.blocks, strict=True):
            out.append(block(down(out[-1]), obj))
        return out


class Up(nn.Module):
    """Twice the resolution, with the trunk's features of that resolution added."""

    def __init__(self, below: int, skip: int, out: int, objects: int):
        super().__init__()
        self.below, self.skip = nn.Conv2d(below, out, 1), nn.Conv2d(skip, out, 1)
        self.film = Film(objects, out)
        self.mix = conv(out, out)

    def forward(self, x: Tensor, skip: Tensor, obj: Tensor) -> Tensor:
        x = F.interpolate(self.below(x), scale_factor=2, mode="nearest") + self.skip(skip)
        return self.mix(F.relu(self.film(x, obj)))


class Decoder(nn.Module):
    """From the trunk's features to a map of 16 cells a side."""

    def __init__(self, objects: int):
        super().__init__()
        self.coarse = Up(_WIDTHS[3], _WIDTHS[2], 64, objects)
        self.fine = Up(64, _WIDTHS[1], MAP_WIDTH, objects)

    def forward(self, features: list[Tensor], obj: Tensor) -> Tensor:
        return self.fine(self.coarse(features[3], features[2], obj), features[1], obj)


class Dense(nn.Module):
    """The network of ``dense``: bins of object coordinates per axis and cell, and a mask.

    Output: (b, 3 * BINS + 1, CELLS, CELLS), logits.
    """

    def __init__(self, objects: int):
        super().__init__()
        self.trunk = Trunk(objects)
        self.decoder = Decoder(objects)
        self.head = PerObject(objects, MAP_WIDTH, 3 * BINS + 1)

    def forward(self, image: Tensor, obj: Tensor) -> Tensor:
        x = self.decoder(self.trunk(image, obj), obj)
        return self.head(x.flatten(2), obj).unflatten(2, (CELLS, CELLS))


class Keypoints(nn.Module):
    """The network of ``keypoints``: heat-map logits, (b, KEYPOINTS, 32, 32)."""

    def __init__(self, objects: int):
        super().__init__()
        self.trunk = Trunk(objects)
        self.decoder = Decoder(objects)
        self.head = PerObject(objects, MAP_WIDTH, 4 * KEYPOINTS)

    def forward(self, image: Tensor, obj: Tensor) -> Tensor:
        x = self.decoder(self.trunk(image, obj), obj)
        # Four cells of the heat map for each of the features.
        return F.pixel_shuffle(self.head(x.flatten(2), obj).unflatten(2, (CELLS, CELLS)), 2)


class Direct(nn.Module):
    """The network of ``direct``: regression of the pose via a coordinate map.

    Output: (b, 9), two rows of the allocentric rotation and the SITE; and the map's logits, (b,
    3 * BINS + 1, CELLS, CELLS), as of :class:`Dense`. After GDR-Net (Wang et al., CVPR 2021).

    Attributes
    ----------
    extent
        The objects' boxes in units of their diameters, (objects, 3).
    """

    def __init__(self, objects: int):
        super().__init__()
        self.trunk = Trunk(objects)
        self.decoder = Decoder(objects)
        self.map = PerObject(objects, MAP_WIDTH, 3 * BINS + 1)
        self.solve = nn.Sequential(
            conv(MAP_WIDTH + 6, 64, 3, 2), conv(64, 80, 3, 2), conv(80, 32, 1)
        )
        self.fully = nn.Linear(32 * 16 + 13, 128)
        self.head = PerObject(objects, 128, 9)
        axis = (torch.arange(CELLS) + 0.5) / CELLS - 0.5
        v, u = torch.meshgrid(axis, axis, indexing="ij")
        self.register_buffer("grid", torch.stack([u, v])[None])
        self.register_buffer("bins", torch.arange(BINS)[:, None, None] / (BINS - 1) - 0.5)
        self.register_buffer("extent", torch.ones(objects, 3))

    def forward(self, image: Tensor, obj: Tensor) -> tuple[Tensor, Tensor]:
        x = self.decoder(self.trunk(image, obj), obj)
        drawn = self.map(x.flatten(2), obj).unflatten(2, (CELLS, CELLS))
        mask = torch.sigmoid(drawn[:, -1:])
        share = drawn[:, :-1].unflatten(1, (3, BINS)).softmax(dim=2)
        points = (share * self.bins).sum(dim=2) * self.extent[obj][..., None, None]
        grid = self.grid.expand(len(x), -1, -1, -1)
        seen = torch.cat([x, points * mask, mask, grid], dim=1)
        seen = torch.cat([self.solve(seen).flatten(1), _moments(points, grid, mask)], dim=1)
        return self.head(F.relu(self.fully(seen))[..., None], obj)[..., 0], drawn


def _moments(points: Tensor, grid: Tensor, mask: Tensor) -> Tensor:
    """Compute a least-squares affine map from object points to image points, (b, 13).

    It gives the learned solver a starting point: the linear map, which for distant objects is two
    rows of the rotation times the scale; both means; the logarithm of the scale; the visible share.
    """
    weight = mask.flatten(2)
    amount = weight.mean(dim=2)
    weight = weight / (weight.sum(dim=2, keepdim=True) + 1e-3)
    x, u = points.flatten(2), grid.flatten(2)
    middle_x, middle_u = (weight * x).sum(2, keepdim=True), (weight * u).sum(2, keepdim=True)
    x, u = x - middle_x, u - middle_u
    spread = (weight * x) @ x.mT + 1e-3 * torch.eye(3, device=points.device)
    a, b, c = spread.unbind(dim=2)
    adjugate = torch.stack([_cross(b, c), _cross(c, a), _cross(a, b)], dim=1)
    determinant = (a * adjugate[:, 0]).sum(dim=1)
    linear = (weight * u) @ x.mT @ adjugate / determinant[:, None, None]
    scale = torch.log(linear.square().sum(dim=(1, 2)) + 1e-3)[:, None]
    parts = [linear.flatten(1), middle_x.flatten(1), middle_u.flatten(1), scale, amount]
    return torch.cat(parts, dim=1)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    after, last = [1, 2, 0], [2, 0, 1]
    return a[:, after] * b[:, last] - a[:, last] * b[:, after]


NETWORKS: dict[str, type[nn.Module]] = {"dense": Dense, "direct": Direct, "keypoints": Keypoints}
