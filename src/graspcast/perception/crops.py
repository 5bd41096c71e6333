"""Square crops around detections, and poses relative to them.

A network that sees only a crop predicts the allocentric rotation, relative to the ray through the
crop's centre (Kundu et al., *3D-RCNN*, CVPR 2018), and the scale-invariant translation (SITE; Li et
al., *CDPN*, ICCV 2019): the position of the object's origin in the crop, and its depth relative to
the crop's size.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray

from graspcast.pose.transforms import transform

__all__ = ["MARGIN", "Crop", "crop_around_box", "ray_rotation", "resample"]

MARGIN = 1.2
"""The crop's side, as a multiple of the detection's longer side."""


@dataclass(frozen=True)
class Crop:
    """A square region of an image.

    Attributes
    ----------
    u, v
        Its centre, pixels; the centre of the image's first pixel is (0, 0).
    side
        Its side length, pixels.
    """

    u: float
    v: float
    side: float

    def to_image(self, points: Float[ndarray, "*n 2"]) -> Float[ndarray, "*n 2"]:
        """Convert coordinates in the crop, from -0.5 to 0.5, to pixels of the image."""
        return np.array([self.u, self.v]) + self.side * points

    def from_image(self, pixels: Float[ndarray, "*n 2"]) -> Float[ndarray, "*n 2"]:
        """Convert pixels of the image to coordinates in the crop, from -0.5 to 0.5."""
        return (pixels - np.array([self.u, self.v])) / self.side

    def decode_pose(
        self,
        rotation: Float[ndarray, "3 3"],
        site: Float[ndarray, " 3"],
        K: Float[ndarray, "3 3"],
        diameter_m: float,
    ) -> Float[ndarray, "4 4"]:
        """Convert a network's allocentric rotation and SITE to a pose, ``cam_T_obj``.

        Parameters
        ----------
        rotation
            Allocentric rotation matrix.
        site
            Scale-invariant translation: the origin's coordinates in the crop (2), and the logarithm
            of its depth in units of focal length times diameter over the crop's side.
        K
            Intrinsics, pixels.
        diameter_m
            The object's diameter, metres.
        """
        u, v = self.to_image(site[:2])
        z = np.exp(site[2]) * K[0, 0] * diameter_m / self.side
        ray = np.array([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], 1.0])
        return transform(ray_rotation(self, K) @ rotation, z * ray)

    def encode_pose(
        self, cam_T_obj: Float[ndarray, "4 4"], K: Float[ndarray, "3 3"], diameter_m: float
    ) -> tuple[Float[ndarray, "3 3"], Float[ndarray, " 3"]]:
        """Convert a pose to allocentric rotation and SITE, the inverse of :meth:`decode_pose`."""
        pixel = K @ cam_T_obj[:3, 3]
        z = pixel[2]
        position = self.from_image(pixel[:2] / z)
        scale = np.log(z * self.side / (K[0, 0] * diameter_m))
        return ray_rotation(self, K).T @ cam_T_obj[:3, :3], np.array([*position, scale])


def ray_rotation(crop: Crop, K: Float[ndarray, "3 3"]) -> Float[ndarray, "3 3"]:
    """Compute the smallest rotation from the optical axis to the ray through a crop's centre."""
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


def crop_around_box(box_xywh: Float[ndarray, " 4"], margin: float = MARGIN) -> Crop:
    """Return the square crop around a box, whose side is ``margin`` times its longer side."""
    x, y, w, h = (float(value) for value in box_xywh)
    return Crop(x + (w - 1) / 2, y + (h - 1) / 2, margin * max(w, h))


def resample(image: UInt8[ndarray, "h w 3"], crop: Crop, size: int) -> UInt8[ndarray, "s s 3"]:
    """Resample a crop to ``size`` x ``size`` pixels; black beyond the image's border."""
    from PIL import Image

    # Pillow counts from the first pixel's border.
    left, top = crop.u + 0.5 - crop.side / 2, crop.v + 0.5 - crop.side / 2
    x0, y0 = int(np.floor(left)) - 2, int(np.floor(top)) - 2
    reach = int(np.ceil(crop.side)) + 6
    around: Any = Image.fromarray(image).crop((x0, y0, x0 + reach, y0 + reach))
    box = (left - x0, top - y0, left - x0 + crop.side, top - y0 + crop.side)
    return np.asarray(around.resize((size, size), Image.Resampling.BILINEAR, box=box))
