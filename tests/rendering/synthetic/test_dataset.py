"""Rendered tables: ground truth against two oracles, repeatability, the BOP layout, bad input."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from graspcast.bop.dataset import BopDataset, read_targets
from graspcast.bop.meshes import Mesh, write_mesh
from graspcast.cli import main
from graspcast.errors import GraspcastError, InputError, UnknownNameError
from graspcast.pose.transforms import invert, transform_points
from graspcast.rendering.opengl_context import open_context
from graspcast.rendering.synthetic.camera import INTRINSICS, random_view
from graspcast.rendering.synthetic.dataset import RenderSettings, read_models, render_dataset
from graspcast.rendering.synthetic.renderer import Frame, Renderer
from graspcast.rendering.synthetic.tabletop import Tabletop

pytest.importorskip("PIL.Image", reason="pillow is not installed (extra render)")


@pytest.fixture(scope="module")
def models(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three solids whose sides have different colours, 60 to 160 mm long."""
    import trimesh

    try:
        open_context(8, 8).free()
    except GraspcastError as error:
        pytest.skip(f"no OpenGL here: {error}")
    folder = tmp_path_factory.mktemp("solids") / "models"
    info = {}
    solids = {
        1: trimesh.creation.box((0.06, 0.10, 0.16)),
        4: trimesh.creation.cylinder(0.03, 0.12),
        7: trimesh.creation.annulus(0.02, 0.05, 0.06),
    }
    for obj_id, solid in solids.items():
        solid = solid.subdivide_to_size(0.01)
        vertices = np.array(solid.vertices) + [0.01 * obj_id, 0.0, 0.02]
        colours = np.rint(255 * (vertices - vertices.min(0)) / np.ptp(vertices, 0)).astype(np.uint8)
        write_mesh(folder / f"obj_{obj_id:06d}.ply", Mesh(vertices, solid.faces), colours)
        low, size = 1e3 * vertices.min(axis=0), 1e3 * np.ptp(vertices, axis=0)
        info[obj_id] = {"diameter": float(np.linalg.norm(size))}
        info[obj_id] |= {f"min_{a}": x for a, x in zip("xyz", low, strict=True)}
        info[obj_id] |= {f"size_{a}": x for a, x in zip("xyz", size, strict=True)}
    (folder / "models_info.json").write_text(json.dumps(info))
    return folder


@pytest.fixture(scope="module")
def renderer(models: Path) -> Iterator[Renderer]:
    tabletop = Tabletop(read_models(models), width=1280, height=960)
    with Renderer(tabletop, INTRINSICS) as made:
        yield made


@pytest.fixture(params=range(4))
def seen(renderer: Renderer, request: pytest.FixtureRequest) -> tuple[Frame, list[np.ndarray]]:
    """A frame of a new table, and the whole silhouette of each object."""
    rng = np.random.default_rng(request.param)
    renderer.tabletop.lay_out(rng)
    renderer.new_layout()
    view = random_view(rng, renderer.tabletop.poses()[renderer.tabletop.present, :3, 3].mean(0))
    whole = [renderer.silhouette(view, k) for k in range(3)]
    return renderer.frame(view), whole


def test_what_each_pixel_shows_lies_on_the_object_where_the_ground_truth_says(
    seen: tuple[Frame, list[np.ndarray]], models: Path
) -> None:
    frame, _ = seen
    for k, mesh in enumerate(read_models(models).values()):
        rows, columns = np.nonzero(frame.label == k)
        if not len(rows):
            continue
        rays = np.stack([columns, rows, np.ones(len(rows))], axis=-1) @ np.linalg.inv(INTRINSICS).T
        points = rays * frame.depth_m[rows, columns][:, None]
        points = transform_points(invert(frame.cam_T_obj[k]), points)
        corners = mesh.vertices[mesh.faces]
        grid = np.array([[a, b, 6 - a - b] for a in range(7) for b in range(7 - a)]) / 6
        surface = np.einsum("gk,fkj->gfj", grid, corners).reshape(-1, 3)
        distance = cKDTree(surface).query(points)[0]
        # A sixth of a 10 mm triangle is between two points of the surface.
        assert np.median(distance) < 0.001 and distance.max() < 0.003


def test_the_mesh_projects_into_the_silhouette_and_spans_it(
    seen: tuple[Frame, list[np.ndarray]], renderer: Renderer, models: Path
) -> None:
    frame, whole = seen
    for k, mesh in enumerate(read_models(models).values()):
        if not renderer.tabletop.present[k]:
            continue
        pixels = transform_points(frame.cam_T_obj[k], mesh.vertices) @ INTRINSICS.T
        pixels = pixels[:, :2] / pixels[:, 2:] + [320, 240]
        rows, columns = np.nonzero(whole[k])
        spans = np.array([columns.min(), rows.min(), columns.max(), rows.max()])
        wanted = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])
        np.testing.assert_allclose(spans, wanted, atol=1.2)
        # The pixels' middles are inside, so on the average they are half a pixel further in.
        np.testing.assert_allclose(spans[:2] - wanted[:2], 0.5, atol=0.7)
        grown = binary_dilation(whole[k], iterations=1)
        column, row = np.rint(pixels).astype(int).T
        inside = (column >= 0) & (row >= 0) & (column < 1280) & (row < 960)
        assert grown[row[inside], column[inside]].mean() > 0.999


def test_what_is_visible_is_part_of_the_silhouette(
    seen: tuple[Frame, list[np.ndarray]],
) -> None:
    frame, whole = seen
    for k, mask in enumerate(whole):
        assert not ((frame.label == k) & ~mask[240:720, 320:960]).sum() > 2


def test_objects_lie_on_the_table_and_not_in_each_other(renderer: Renderer) -> None:
    tabletop = renderer.tabletop
    for seed in range(6):
        tabletop.lay_out(np.random.default_rng(seed))
        assert tabletop.data.ncon == 0 or tabletop.data.contact.dist.min() > -0.003
        poses = tabletop.poses()
        for k, mesh in enumerate(read_models_of(renderer)):
            if tabletop.present[k]:
                assert transform_points(poses[k], mesh)[:, 2].min() > -0.003


def read_models_of(renderer: Renderer) -> list[np.ndarray]:
    """The meshes that MuJoCo holds, back in the frame of their files."""
    model, out = renderer.tabletop.model, []
    for k, geom in enumerate(renderer.tabletop.geoms):
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(float)
        out.append(transform_points(invert(renderer.tabletop._geom_T_obj[k]), vertices))
    return out


def test_mujoco_s_own_frame_is_undone(renderer: Renderer, models: Path) -> None:
    for kept, mesh in zip(read_models_of(renderer), read_models(models).values(), strict=True):
        np.testing.assert_allclose(np.sort(kept, axis=0), np.sort(mesh.vertices, axis=0), atol=1e-6)


def digests(root: Path) -> dict[str, str]:
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file()
    }


def test_the_same_seed_the_same_files_and_more_scenes_leave_the_first_alone(
    models: Path, tmp_path: Path
) -> None:
    one = render_dataset(models, tmp_path / "one", RenderSettings(scenes=1, images=2, seed=3))
    again = render_dataset(models, tmp_path / "again", RenderSettings(scenes=1, images=2, seed=3))
    more = render_dataset(models, tmp_path / "more", RenderSettings(scenes=2, images=2, seed=3))
    other = render_dataset(models, tmp_path / "other", RenderSettings(scenes=1, images=2, seed=4))
    assert digests(one) == digests(again)
    assert digests(one / "test" / "000001") == digests(more / "test" / "000001")
    assert digests(one / "test" / "000001") != digests(other / "test" / "000001")


def test_our_own_reader_reads_all_of_it(models: Path, tmp_path: Path) -> None:
    settings = RenderSettings(scenes=2, images=2, seed=1, image_format="png")
    root = render_dataset(models, tmp_path / "made", settings, obj_ids=[1, 7])
    dataset = BopDataset(root)
    truth = dataset.ground_truth
    assert set(truth.obj_id.tolist()) <= {1, 7} and len(truth) >= 4
    assert sorted(dataset.images) == [(1, 0), (1, 1), (2, 0), (2, 1)]
    assert dataset.image(2, 1).shape == (480, 640, 3)
    np.testing.assert_allclose(dataset.camera_of(1, 0).K, INTRINSICS)
    assert ((truth.visib_fract >= 0) & (truth.visib_fract <= 1)).all()
    targets = {
        (t.scene_id, t.im_id, t.obj_id) for t in read_targets(root / "test_targets_bop19.json")
    }
    rows = zip(truth.scene_id, truth.im_id, truth.obj_id, truth.visib_fract, strict=True)
    assert targets == {(s, i, o) for s, i, o, share in rows if share >= 0.1}
    assert dataset.models.mesh(7).vertices.shape == read_models(models)[7].vertices.shape
    # The box spans the projected mesh (another route than the silhouette that it was made from).
    assert truth.box_xywh is not None
    for k in range(len(truth)):
        points = dataset.models.mesh(int(truth.obj_id[k])).vertices
        pixels = transform_points(truth.cam_T_obj[k], points) @ INTRINSICS.T
        pixels = pixels[:, :2] / pixels[:, 2:]
        x, y, width, height = truth.box_xywh[k]
        spans = [x - 0.5, y - 0.5, x + width - 0.5, y + height - 0.5]
        wanted = [*pixels.min(axis=0), *pixels.max(axis=0)]
        np.testing.assert_allclose(spans, wanted, atol=1.2)
    made = json.loads((root / "render.json").read_text())
    assert made["settings"]["seed"] == 1 and "mujoco" in made["versions"]


def test_colours_are_those_of_the_mesh(renderer: Renderer, models: Path) -> None:
    # The colours are the place in the box, so the picture tells places, up to the light.
    rng = np.random.default_rng(0)
    renderer.tabletop.lay_out(rng)
    renderer.new_layout()
    frame = renderer.frame(random_view(rng, np.array([0.0, 0.0, 0.05])))
    for k, mesh in enumerate(read_models(models).values()):
        rows, columns = np.nonzero(frame.label == k)
        if len(rows) < 200:
            continue
        rays = np.stack([columns, rows, np.ones(len(rows))], axis=-1) @ np.linalg.inv(INTRINSICS).T
        points = rays * frame.depth_m[rows, columns][:, None]
        points = transform_points(invert(frame.cam_T_obj[k]), points)
        place = (points - mesh.vertices.min(0)) / np.ptp(mesh.vertices, 0)
        shown = frame.rgb[rows, columns].astype(float)
        # Light of nearly one colour scales all three alike, so their shares stay.
        expected = place / place.sum(axis=1, keepdims=True)
        share = shown / shown.sum(axis=1, keepdims=True)
        bright = (shown.sum(axis=1) > 60) & (shown.max(axis=1) < 250)
        assert np.abs(expected - share)[bright].mean() < 0.05


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"scenes": 0}, "at least one"),
        ({"images": -1}, "at least one"),
        ({"image_format": "bmp"}, "jpg, png, webp"),
        ({"quality": 101}, "1 to 100"),
        ({"seed": -1}, "0 or more"),
    ],
)
def test_settings_that_make_no_sense(changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        RenderSettings(**changes)  # type: ignore[arg-type]


def test_what_cannot_be_rendered_leaves_nothing(
    models: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(UnknownNameError, match="unknown object '2'; known: 1, 4, 7"):
        render_dataset(models, tmp_path / "a", obj_ids=[2])
    full = tmp_path / "full"
    full.mkdir()
    (full / "kept").write_text("mine")
    assert main(["render", "--models", str(models), "--out", str(full)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert main(["render", "--models", str(tmp_path), "--out", str(tmp_path / "b")]) == 2
    assert "models_info.json" in capsys.readouterr().err
    for split in ("../out", "models", "a/b", ""):
        command = [
            "render",
            "--models",
            str(models),
            "--out",
            str(tmp_path / "c"),
            "--split",
            split,
        ]
        assert main(command) == 2
        assert "a split is a name such as test" in capsys.readouterr().err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["full"]
    assert [p.name for p in full.iterdir()] == ["kept"]


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is Linux's")
def test_without_opengl_one_message_and_nothing_written(models: Path, tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "graspcast",
        "render",
        "--models",
        str(models),
        "--scenes",
        "1",
    ]
    source = str(Path(__file__).parents[3] / "src")
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("MUJOCO", "PYOPENGL"))}
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "out")],
        env={**clean, "PYTHONPATH": source, "MUJOCO_EGL_DEVICE_ID": "99"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2 and "libegl1" in done.stderr and "Traceback" not in done.stderr
    assert not list(tmp_path.iterdir())
