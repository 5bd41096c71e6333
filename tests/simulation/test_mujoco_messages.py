from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from graspcast.errors import InputError
from graspcast.simulation.mujoco_messages import compile_spec


def _attached(timestep: float) -> mujoco.MjSpec:
    """Return a scene to which a model with another time step is attached."""
    child = mujoco.MjSpec()
    child.option.timestep = timestep
    child.worldbody.add_body(name="hand").add_geom(size=(0.1, 0, 0))
    scene = mujoco.MjSpec()
    scene.worldbody.add_frame().attach_body(child.worldbody.first_body(), "hand/", "")
    return scene


def test_warnings_are_kept_and_not_printed(recwarn: pytest.WarningsRecorder) -> None:
    remarks: list[str] = []
    assert compile_spec(_attached(0.0005), "a scene", remarks).nbody == 2
    assert not recwarn.list
    assert len(remarks) == 1 and "timestep" in remarks[0] and "\n" not in remarks[0]


def test_an_error_is_one_line_that_names_what_was_compiled() -> None:
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name="empty").add_freejoint()
    with pytest.raises(InputError, match=r"^hand\.xml does not compile: .*mass") as problem:
        compile_spec(spec, "hand.xml")
    assert "\n" not in str(problem.value)


def test_no_log_file_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    scene = _attached(0.002)
    scene.body("hand/hand").add_freejoint()
    model = compile_spec(scene, "a scene")
    data = mujoco.MjData(model)
    data.qpos[:] = float("nan")
    mujoco.mj_step(model, data)
    assert not list(tmp_path.iterdir())
