"""Random poses and small files that several tests need."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy import ndarray
from scipy.spatial.transform import Rotation

from graspcast.bop.results import Results
from graspcast.pose.transforms import transform


def random_poses(n: int, seed: int = 0, *, depth_m: float = 1.0) -> ndarray:
    """Poses in front of a camera, (n, 4, 4)."""
    rng = np.random.default_rng(seed)
    translation = rng.normal(scale=0.1, size=(n, 3)) + [0.0, 0.0, depth_m]
    if n == 0:  # of which SciPy before 1.15 makes no matrices
        return np.empty((0, 4, 4))
    return transform(Rotation.random(n, random_state=seed).as_matrix(), translation)


def nudged(poses: ndarray, seed: int, *, metres: float = 0.01, radians: float = 0.1) -> ndarray:
    """The same poses with small random errors."""
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(rng.normal(scale=radians, size=(len(poses), 3))).as_matrix()
    out = poses.copy()
    out[:, :3, :3] = turn @ poses[:, :3, :3]
    out[:, :3, 3] += rng.normal(scale=metres, size=(len(poses), 3))
    return out


def results_of(poses: ndarray, *, obj_id: int = 1, scene_id: int = 1) -> Results:
    """One detection an image, images 0, 1, …"""
    n = len(poses)
    return Results(
        scene_id=np.full(n, scene_id),
        im_id=np.arange(n),
        obj_id=np.full(n, obj_id),
        score=np.linspace(1, 0, n),
        cam_T_obj=poses,
        time_s=np.full(n, -1.0),
        line=np.arange(n) + 2,
    )


def write_csv(path: Path, *rows: str, header: str = "scene_id,im_id,obj_id,score,R,t,time") -> Path:
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


ROW = "1,2,3,0.5,1 0 0 0 1 0 0 0 1,10 20 900,-1"


def write_models(folder: Path, **entries: dict[str, object]) -> Path:
    """A models directory of unit-ish boxes, 40 x 60 x 100 mm, with these models_info additions."""
    import json

    folder.mkdir(parents=True, exist_ok=True)
    size = np.array([40.0, 60.0, 100.0])
    corners = (np.array(np.meshgrid([0, 1], [0, 1], [0, 1])).reshape(3, -1).T - 0.5) * size
    info = {}
    for key, extra in (entries or {"obj_1": {}}).items():
        number = int(key.split("_")[1])
        base = {"diameter": float(np.linalg.norm(size))}
        for axis, length in zip("xyz", size.tolist(), strict=True):
            base |= {f"min_{axis}": -length / 2, f"size_{axis}": length}
        info[str(number)] = base | extra
        faces = "3 0 1 2\n3 1 3 2\n"
        header = (
            "ply\nformat ascii 1.0\nelement vertex 8\nproperty float x\nproperty float y\n"
            "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
        )
        points = "".join(" ".join(map(repr, c)) + "\n" for c in corners.tolist())
        (folder / f"obj_{number:06d}.ply").write_text(header + points + faces)
    (folder / "models_info.json").write_text(json.dumps(info))
    return folder
