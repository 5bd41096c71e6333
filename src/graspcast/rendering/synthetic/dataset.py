"""Synthetic BOP datasets: rendered images, ground truth, cameras, targets, boxes, models.

Layout: https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md
"""

from __future__ import annotations

import platform
import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray

from graspcast._version import __version__
from graspcast.bop.dataset import BopDataset
from graspcast.bop.detections import MIN_VISIBLE_FRACTION, jittered, write_detections
from graspcast.bop.meshes import read_coloured_mesh
from graspcast.bop.models import Models
from graspcast.bop.units import millimetres
from graspcast.errors import FormatError, InputError
from graspcast.io.files import temporary_directory
from graspcast.io.json import read_json, write_json
from graspcast.io.progress import Count
from graspcast.pose.transforms import invert
from graspcast.rendering.synthetic.camera import INTRINSICS, View, random_view
from graspcast.rendering.synthetic.renderer import Frame, Renderer
from graspcast.rendering.synthetic.tabletop import ColouredMesh, Tabletop

__all__ = ["RenderSettings", "read_models", "render_dataset"]

WIDTH, HEIGHT = 640, 480
_ENDINGS = {"jpg": "JPEG", "png": "PNG", "webp": "WEBP"}


@dataclass(frozen=True)
class RenderSettings:
    """Settings of a rendered dataset.

    Attributes
    ----------
    scenes
        Number of tables, each with its own arrangement of objects.
    images
        Views of each table, with different light.
    seed
        Random seed; scene k depends only on the seed, k and the models.
    image_format
        ``jpg``, ``png`` or ``webp``.
    quality
        Quality of JPEG and WebP, from 1 to 100.
    """

    scenes: int = 20
    images: int = 10
    seed: int = 0
    image_format: str = "jpg"
    quality: int = 85

    def __post_init__(self) -> None:
        if self.scenes < 1 or self.images < 1:
            raise InputError(
                f"{self.scenes} scenes of {self.images} images: at least one of each is needed"
            )
        if self.image_format not in _ENDINGS:
            raise InputError(
                f"images are written as {', '.join(_ENDINGS)}, not as {self.image_format!r}"
            )
        if self.seed < 0 or not 1 <= self.quality <= 100:
            raise InputError("a seed is 0 or more, and a quality from 1 to 100")


def read_models(
    directory: str | PathLike[str], obj_ids: Sequence[int] = ()
) -> dict[int, ColouredMesh]:
    """Read coloured meshes of a BOP directory of models, by object id: these objects, or all.

    Raises
    ------
    FormatError
        If ``models_info.json`` or a mesh is missing or wrong.
    UnknownNameError
        For an unknown object.
    """
    models = Models(directory)
    out = {}
    for obj_id in obj_ids or sorted(models.info):
        mesh, colours = read_coloured_mesh(
            models.directory / f"obj_{models[obj_id].obj_id:06d}.ply"
        )
        if not len(mesh.faces):
            raise FormatError(
                models.directory / f"obj_{obj_id:06d}.ply",
                "has no faces, so it cannot be rendered",
            )
        out[obj_id] = ColouredMesh(mesh.vertices, mesh.faces, colours)
    return out


def render_dataset(
    models: str | PathLike[str],
    out: str | PathLike[str],
    settings: RenderSettings | None = None,
    *,
    obj_ids: Sequence[int] = (),
    split: str = "test",
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Render images of objects on tables as a BOP dataset; the directory is written atomically.

    ``SPLIT_detections_jittered.json`` holds detections for estimators: ground-truth boxes with
    random displacements (:func:`graspcast.bop.detections.jittered`).

    Parameters
    ----------
    models
        A BOP directory of models.
    out
        The dataset's directory; it must not exist, or be empty.
    settings
        Number of scenes and images, seed, image format.
    obj_ids
        Restrict to these objects; by default all.
    split
        The split's name.
    progress
        Called with the share of images done, from 0 to 1, and the next image.

    Raises
    ------
    InputError
        If OpenGL does not work, or ``out`` cannot be written or is not empty.
    ExtraMissingError
        If PyOpenGL is not installed.
    FormatError, UnknownNameError
        As :func:`read_models`.
    """
    settings = settings or RenderSettings()
    if not re.fullmatch(r"\w+", split) or split == "models":
        raise InputError(
            f"a split is a name such as test, other than models; not {split!r}",
            parameters=("split",),
        )
    out = Path(out)
    meshes = read_models(models, obj_ids)
    try:
        if out.exists() and (not out.is_dir() or any(out.iterdir())):
            raise InputError(f"{out}: exists already", parameters=("out",))
        with temporary_directory(out.parent) as scratch:
            made = scratch / "dataset"
            _write(made, Path(models), meshes, settings, split, progress)
            if out.exists():
                out.rmdir()
            made.rename(out)
    except OSError as error:
        raise InputError(
            f"{out}: cannot be written ({error.strerror})", parameters=("out",)
        ) from error
    return out


def _write(
    root: Path,
    models: Path,
    meshes: dict[int, ColouredMesh],
    settings: RenderSettings,
    split: str,
    progress: Callable[[float, str], None] | None,
) -> None:
    from graspcast.simulation.engine import mujoco

    (root / "models").mkdir(parents=True)
    info = read_json(models / "models_info.json", dict)
    _dump(root / "models" / "models_info.json", {str(k): info[str(k)] for k in meshes})
    for obj_id in meshes:
        name = f"obj_{obj_id:06d}.ply"
        shutil.copyfile(models / name, root / "models" / name)
    targets: list[dict[str, int]] = []
    tabletop = Tabletop(meshes, width=2 * WIDTH, height=2 * HEIGHT)
    with Renderer(tabletop, INTRINSICS, width=WIDTH, height=HEIGHT) as renderer:
        for scene in range(1, settings.scenes + 1):
            folder = root / split / f"{scene:06d}"
            targets += _write_scene(folder, scene, renderer, settings, progress)
    _dump(root / f"{split}_targets_bop19.json", targets)
    fx, fy, (cx, cy) = INTRINSICS[0, 0], INTRINSICS[1, 1], INTRINSICS[:2, 2]
    _dump(
        root / "camera.json",
        {"cx": cx, "cy": cy, "depth_scale": 1.0, "fx": fx, "fy": fy, "height": HEIGHT,
         "width": WIDTH},
    )  # fmt: skip
    boxes = jittered(BopDataset(root, split=split), settings.seed)
    write_detections(root / f"{split}_detections_jittered.json", boxes)
    _dump(
        root / "render.json",
        {
            "about": "rendered by graspcast render; there are no photographs in it",
            "settings": asdict(settings),
            "objects": list(meshes),
            "versions": {
                "graspcast": __version__,
                "mujoco": mujoco.__version__,
                "numpy": np.__version__,
                "python": platform.python_version(),
            },
        },
    )


def _write_scene(
    folder: Path,
    scene: int,
    renderer: Renderer,
    settings: RenderSettings,
    progress: Callable[[float, str], None] | None,
) -> list[dict[str, int]]:
    """Simulate a scene, and write its images and ground truth; return its BOP targets."""
    rng = np.random.default_rng([settings.seed, scene])
    tabletop = renderer.tabletop
    tabletop.lay_out(rng)
    renderer.new_layout()
    (folder / "rgb").mkdir(parents=True)
    centre = tabletop.poses()[tabletop.present, :3, 3].mean(axis=0)
    truth, seen, cameras = {}, {}, {}
    targets = []
    for image in range(settings.images):
        if progress:
            done = (scene - 1) * settings.images + image
            count = Count(done, settings.scenes * settings.images, "images")
            progress(count.share, count)
        view = random_view(rng, centre)
        frame = renderer.frame(view)
        _save(folder / "rgb" / f"{image:06d}", frame.rgb, settings)
        instances = _instances(renderer, view, frame)
        truth[str(image)] = [instance for instance, _ in instances]
        seen[str(image)] = [visibility for _, visibility in instances]
        cameras[str(image)] = _camera(view)
        targets += [
            {"im_id": image, "inst_count": 1, "obj_id": i["obj_id"], "scene_id": scene}
            for i, v in instances
            if v["visib_fract"] >= MIN_VISIBLE_FRACTION
        ]
    _dump(folder / "scene_gt.json", truth)
    _dump(folder / "scene_gt_info.json", seen)
    _dump(folder / "scene_camera.json", cameras)
    return targets


def _instances(
    renderer: Renderer, view: View, frame: Frame
) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Return ground truth and visibility of the objects whose silhouettes overlap the image."""
    out = []
    for k in np.flatnonzero(renderer.tabletop.present):
        whole = renderer.silhouette(view, int(k))
        top, left = frame.label.shape[0] // 2, frame.label.shape[1] // 2
        if not whole[top : top + frame.label.shape[0], left : left + frame.label.shape[1]].any():
            continue
        visible = frame.label == k
        x, y, width, height = _box(whole)
        count, shown = int(whole.sum()), int(visible.sum())
        pose = frame.cam_T_obj[k]
        truth = {
            "cam_R_m2c": pose[:3, :3].ravel().tolist(),
            "cam_t_m2c": millimetres(pose[:3, 3]).tolist(),
            "obj_id": renderer.tabletop.obj_ids[k],
        }
        seen = {
            "bbox_obj": [x - left, y - top, width, height],
            "bbox_visib": _box(visible) if shown else [-1, -1, -1, -1],
            "px_count_all": count,
            "px_count_valid": shown,
            "px_count_visib": shown,
            "visib_fract": min(1.0, shown / count),
        }
        out.append((truth, seen))
    return out


def _box(mask: Bool[ndarray, "h w"]) -> list[int]:
    """Return left, top, width and height of a mask."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return [
        int(columns[0]),
        int(rows[0]),
        int(columns[-1] - columns[0] + 1),
        int(rows[-1] - rows[0] + 1),
    ]


def _camera(view: View) -> dict[str, Any]:
    cam_T_sim: Float[ndarray, "4 4"] = invert(view.sim_T_cam)
    return {
        "cam_K": INTRINSICS.ravel().tolist(),
        "cam_R_w2c": cam_T_sim[:3, :3].ravel().tolist(),
        "cam_t_w2c": millimetres(cam_T_sim[:3, 3]).tolist(),
        "depth_scale": 1.0,
    }


def _save(stem: Path, rgb: UInt8[ndarray, "h w 3"], settings: RenderSettings) -> None:
    from PIL import Image

    kind = _ENDINGS[settings.image_format]
    options: dict[str, Any] = {} if kind == "PNG" else {"quality": settings.quality}
    Image.fromarray(rgb).save(stem.with_suffix(f".{settings.image_format}"), kind, **options)


def _dump(path: Path, content: Any) -> None:
    """Write JSON with one entry of the top level per line, as BOP's files have it."""
    write_json(path, content, one_entry_a_line=True)
