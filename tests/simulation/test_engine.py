"""MuJoCo is imported in one place, and kept from what its version computes wrongly."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import graspcast
from graspcast.simulation import engine
from graspcast.simulation.engine import avoid_wrong_factors, jacobian, mujoco

# The OpenGL contexts and the viewer are modules of MuJoCo, imported once it has been checked.
PARTS = {"rendering/opengl_context.py", "rendering/trials/viewer.py"}


def test_no_other_module_imports_mujoco() -> None:
    root = Path(graspcast.__file__).parent
    for path in root.rglob("*.py"):
        name, text = path.relative_to(root).as_posix(), path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "mujoco" in text else ():
            if isinstance(node, ast.Import):
                assert "mujoco" not in {alias.name for alias in node.names}, name
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "mujoco":
                assert name in PARTS, name


class Mujoco:
    """MuJoCo of another version."""

    mjtJacobian = mujoco.mjtJacobian

    def __init__(self, version: str):
        self.__version__ = version


@pytest.mark.parametrize(("version", "storage"), [("4.0.0", "DENSE"), ("4.0.1", "SPARSE")])
def test_sparse_jacobians_only_where_they_are_factorized_rightly(
    version: str, storage: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "mujoco", Mujoco(version))
    assert jacobian("sparse") == getattr(mujoco.mjtJacobian, f"mjJAC_{storage}")
    assert jacobian("dense") == mujoco.mjtJacobian.mjJAC_DENSE


@pytest.mark.parametrize(("version", "storage"), [("4.0.0", "DENSE"), ("4.0.1", "AUTO")])
def test_other_models_too(version: str, storage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "mujoco", Mujoco(version))
    model = avoid_wrong_factors(mujoco.MjModel.from_xml_string("<mujoco/>"))
    assert model.opt.jacobian == getattr(mujoco.mjtJacobian, f"mjJAC_{storage}")


def test_an_import_leaves_the_choice_of_opengl_as_it_was() -> None:
    code = (
        "import os; os.environ['MUJOCO_GL'] = 'glfw'; import graspcast.simulation.engine; "
        "print(os.environ['MUJOCO_GL'])"
    )
    places = {**os.environ, "PYTHONPATH": str(Path(graspcast.__file__).parents[1])}
    run = subprocess.run([sys.executable, "-c", code], env=places, capture_output=True, text=True)
    assert run.stdout.strip() == "glfw", run.stderr
