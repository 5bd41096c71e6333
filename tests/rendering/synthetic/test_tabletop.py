"""Objects on a table: rest poses and frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from graspcast.pose.transforms import invert, transform_points
from graspcast.rendering.synthetic.dataset import read_models
from graspcast.rendering.synthetic.renderer import Renderer


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
