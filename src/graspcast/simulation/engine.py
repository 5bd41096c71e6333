"""MuJoCo, which is imported here alone: checked, and without a choice of its own of OpenGL.

Modules that use it write ``from graspcast.simulation.engine import mujoco``.
"""

from __future__ import annotations

import importlib
import os
import platform
import sys
from typing import Any

from graspcast.errors import InstallationError
from graspcast.simulation.mujoco_version import (
    OLDEST,
    InstalledMujoco,
    installed_mujoco,
    release_of,
)

__all__ = ["avoid_wrong_factors", "jacobian", "mujoco"]


def _import_checked() -> Any:
    """Import MuJoCo.

    Raises
    ------
    InstallationError
        If it is not installed, is too old, or its files are not those of one version.
    """
    installed = installed_mujoco()
    if installed.problem:
        raise _error(installed.problem, installed)
    try:
        module = _import_without_opengl()
        version = str(module.mj_versionString())
    except (ImportError, OSError, AttributeError) as error:
        problem = f"MuJoCo in {installed.folder} cannot be imported ({error})"
        raise _error(problem, installed) from error
    for name, stated in installed.owners.items():
        if release_of(stated) != release_of(version):
            problem = f"{name} {stated} is installed, but the library in {installed.folder} is"
            raise _error(f"{problem} MuJoCo {version}", installed)
    if release_of(version) < OLDEST:
        oldest = ".".join(map(str, OLDEST))
        raise InstallationError(
            f"MuJoCo {version} is installed, but graspcast needs {oldest} or newer: "
            f"pip install --upgrade 'mujoco>={oldest}'"
        )
    return module


def _import_without_opengl() -> Any:
    """Import MuJoCo without its own choice of an OpenGL backend.

    On Linux the import fails if ``MUJOCO_GL`` names a backend that is not installed;
    ``rendering.opengl_context`` chooses the backend when something is rendered.
    """
    if platform.system() != "Linux" or "mujoco" in sys.modules:
        return importlib.import_module("mujoco")
    before = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = "disable"
    try:
        return importlib.import_module("mujoco")
    finally:
        del os.environ["MUJOCO_GL"]
        if before is not None:
            os.environ["MUJOCO_GL"] = before


def _error(problem: str, installed: InstalledMujoco) -> InstallationError:
    return InstallationError(f"{problem}. {installed.remedy}")


mujoco = _import_checked()


def jacobian(storage: str) -> Any:
    """Return MuJoCo's constant for how Jacobians of constraints are stored.

    Parameters
    ----------
    storage
        ``"dense"`` or ``"sparse"``. MuJoCo 4.0.0 factorizes sparse ones wrongly (mended in 4.0.1),
        so with it they are always dense.
    """
    name = "dense" if mujoco.__version__ == "4.0.0" else storage
    return getattr(mujoco.mjtJacobian, "mjJAC_" + name.upper())


def avoid_wrong_factors(model: Any) -> Any:
    """Return a model, kept from sparse Jacobians if this MuJoCo factorizes them wrongly.

    Left to itself, MuJoCo makes them sparse from 60 degrees of freedom on.
    """
    if mujoco.__version__ == "4.0.0":
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    return model
