"""The square around a detection, and poses as they are seen in it.

A small network looks at nothing but the crop. What it can tell is therefore said in the crop's own
terms: the rotation as seen along the ray through the crop's middle (allocentric, Kundu et al.,
3D-RCNN, CVPR 2018), and the position by where the object's origin is in the crop and how large it
appears (scale-invariant translation, Li et al., CDPN, ICCV 2019).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.pose.transforms import transform

__all__ = ["MARGIN", "Crop", "crop_of", "cut", "ray_rotation"]

MARGIN = 1.2
"""The crop's side, as a multiple of the detection's longer side."""


@dataclass(frozen=True)
class Crop:
    """A square in an image.

    Attributes
    ----------
    u, v
        Its middle, pixels; the middle of the image's first pixel is (0, 0).
    side
        Its side, pixels.
    """

    u: float
    v: float
    side: float

    def to_image(self, places: Float[ndarray, "*n 2"]) -> Float[ndarray, "*n 2"]:
        """Places in the crop (-0.5 to 0.5 each way) to pixels of the image."""
        return np.array([self.u, self.v]) + self.side * places

    def from_image(self, pixels: Float[ndarray, "*n 2"]) -> Float[ndarray, "*n 2"]:
        """Pixels of the image to places in the crop (-0.5 to 0.5 each way)."""
        return (pixels - np.array([self.u, self.v])) / self.side

    def pose(
        self,
        rotation: Float[ndarray, "3 3"],
        site: Float[ndarray, " 3"],
        K: Float[ndarray, "3 3"],
        diameter_m: float,
    ) -> Float[ndarray, "4 4"]:
        """``cam_T_obj`` from what a network says.

        Parameters
        ----------
        rotation
            Allocentric.
        site
            The origin's place in the crop (2), and the logarithm of its distance along the optical
            axis in units of focal length times diameter over the crop's side.
        K
            Intrinsics.
        diameter_m
            The object's diameter.
        """
        u, v = self.to_image(site[:2])
        z = np.exp(site[2]) * K[0, 0] * diameter_m / self.side
        ray = np.array([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], 1.0])
        return transform(ray_rotation(self, K) @ rotation, z * ray)

    def terms(
        self, cam_T_obj: Float[ndarray, "4 4"], K: Float[ndarray, "3 3"], diameter_m: float
    ) -> tuple[Float[ndarray, "3 3"], Float[ndarray, " 3"]]:
        """Allocentric rotation and site of a pose: :meth:`pose` undone."""
        pixel = K @ cam_T_obj[:3, 3]
        z = pixel[2]
        place = self.from_image(pixel[:2] / z)
        scale = np.log(z * self.side / (K[0, 0] * diameter_m))
        return ray_rotation(self, K).T @ cam_T_obj[:3, :3], np.array([*place, scale])


def ray_rotation(crop: Crop, K: Float[ndarray, "3 3"]) -> Float[ndarray, "3 3"]:
    """The smallest rotation that turns the optical axis to the ray through a crop's middle."""
    x, y = (crop.u - K[0, 2]) / K[0, 0], (crop.v - K[1, 2]) / K[1, 1]
    ray = np.array([x, y, 1.0]) / np.sqrt(x * x + y * y + 1.0)
    a, b, c = ray
    return np.array(
        [
            [1 - a * a / (1 + c), -a * b / (1 + c), a],
            [-a * b / (1 + c), 1 - b * b / (1 + c), b],
            [-a, -b, c],
        ]
    )


def crop_of(box_xywh: Float[ndarray, " 4"], margin: float = MARGIN) -> Crop:
    """The square around a box (first column, first row, columns, rows)."""
    x, y, w, h = (float(value) for value in box_xywh)
    return Crop(x + (w - 1) / 2, y + (h - 1) / 2, margin * max(w, h))


def cut(image: UInt8[ndarray, "h w 3"], crop: Crop, size: int) -> UInt8[ndarray, "s s 3"]:
    """What a crop shows, in ``size`` pixels a side; black beyond the image's border."""
    from PIL import Image

    # Pillow counts from the first pixel's border.
    left, top = crop.u + 0.5 - crop.side / 2, crop.v + 0.5 - crop.side / 2
    x0, y0 = int(np.floor(left)) - 2, int(np.floor(top)) - 2
    reach = int(np.ceil(crop.side)) + 6
    around: Any = Image.fromarray(image).crop((x0, y0, x0 + reach, y0 + reach))
    box = (left - x0, top - y0, left - x0 + crop.side, top - y0 + crop.side)
    return np.asarray(around.resize((size, size), Image.Resampling.BILINEAR, box=box))
