"""Images: those that come twice, and those of another size than the camera's."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

from graspcast.bop.cameras import other_size_problem
from graspcast.diagnosis.case import Case, Scenes
from graspcast.diagnosis.finding import Finding

__all__ = ["image_findings"]


def image_findings(case: Case) -> Iterator[Finding]:
    """Look at the image files of all scenes."""
    for scenes in case.scenes:
        if scenes.images:
            yield from _duplicates(scenes)
            yield from _sizes(scenes)
            yield from _without_image(scenes)


def _duplicates(scenes: Scenes) -> Iterator[Finding]:
    seen: dict[bytes, Path] = {}
    twice: list[tuple[Path, Path]] = []
    for path in scenes.images.values():
        digest = hashlib.blake2b(path.read_bytes(), digest_size=16).digest()
        if (first := seen.setdefault(digest, path)) != path:
            twice.append((first, path))
    if twice:
        one, other = twice[0]
        yield Finding(
            "error",
            "duplicate-images",
            str(scenes.path),
            f"{len(twice)} of {len(scenes.images)} images are, byte for byte, another one: "
            f"{other.relative_to(scenes.path)} is {one.relative_to(scenes.path)}",
            "Remove the images that come twice, and their rows: they count as two trials, and may "
            "stand in training and calibration",
            {"duplicates": len(twice), "images": len(scenes.images)},
        )


def _sizes(scenes: Scenes) -> Iterator[Finding]:
    from PIL import Image, UnidentifiedImageError

    dataset = scenes.dataset
    wanted = dataset.image_size
    wrong: list[tuple[Path, tuple[int, int]]] = []
    broken: list[Path] = []
    for key, path in scenes.images.items():
        try:
            with Image.open(path) as image:
                own = scenes.cameras_known and _suits(scenes, key, image.size)
                if wanted is not None and image.size != wanted and not own:
                    wrong.append((path, image.size))
        except (OSError, UnidentifiedImageError, Image.DecompressionBombError):
            broken.append(path)
    if broken:
        yield Finding(
            "error",
            "images-unreadable",
            str(broken[0]),
            f"{len(broken)} of {len(scenes.images)} images cannot be read",
            "Copy them again",
            {"broken": len(broken)},
        )
    if wrong and wanted is not None:
        path, size = wrong[0]
        yield Finding(
            "error",
            "image-size",
            str(path),
            f"{len(wrong)} of {len(scenes.images)} images have another size than camera.json says, "
            f"this one {size[0]} x {size[1]} instead of {wanted[0]} x {wanted[1]} pixels",
            "Scale the images back, or multiply fx, fy, cx and cy by "
            f"{size[0] / wanted[0]:.4g}, and write the new size",
            {"images": len(wrong), "size": list(size), "stated": list(wanted)},
        )


def _suits(scenes: Scenes, key: tuple[int, int], size: tuple[int, int]) -> bool:
    """Return whether an image has intrinsics of its own, and they may be of its size."""
    if not scenes.dataset.scene_folders.has("camera"):
        return False
    own = scenes.dataset.scene_cameras.get(key)
    return own is not None and not other_size_problem(scenes.dataset.root, own.K, size)


def _without_image(scenes: Scenes) -> Iterator[Finding]:
    truth = scenes.truth
    if truth is None:
        return
    annotated = set(zip(truth.scene_id.tolist(), truth.im_id.tolist(), strict=True))
    lacking = sorted(annotated - set(scenes.images))
    if len(lacking) == len(annotated):
        first = "/".join(map(str, lacking[0]))
        yield Finding(
            "error",
            "images-unmatched",
            str(scenes.path),
            f"none of the {len(annotated)} annotated images has a file (the first is {first})",
            "Name the files by the numbers of scene_gt.json",
            {"annotated": len(annotated)},
        )
