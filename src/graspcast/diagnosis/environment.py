"""The environment: what keeps graspcast from running here, or makes it slow."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from pathlib import Path

from graspcast.diagnosis.finding import Finding
from graspcast.errors import GraspcastError, InstallationError
from graspcast.io.address_space import check_address_space
from graspcast.io.cache import cache_directory
from graspcast.simulation.mujoco_version import installed_mujoco

__all__ = ["environment_findings"]


def environment_findings() -> list[Finding]:
    """Look at packages, OpenGL, directories that are written to, and limits of the process."""
    return [*_address_space(), *_mujoco(), *_opengl(), *_caches()]


def _address_space() -> Iterator[Finding]:
    try:
        check_address_space()
    except GraspcastError as error:
        yield Finding(
            "error", "address-space", "environment", str(error), "Raise the limit, or lift it"
        )


def _mujoco() -> Iterator[Finding]:
    """Say that MuJoCo is not installed, or that its files are not those of one version."""
    installed = installed_mujoco()
    if installed.problem:
        yield Finding(
            "error",
            "broken-mujoco" if installed.folder else "no-mujoco",
            "environment",
            installed.problem,
            installed.remedy,
            {"packages": installed.owners, "folder": str(installed.folder or "")},
        )
        return
    try:
        import graspcast.simulation.engine  # noqa: F401
    except InstallationError as error:
        yield Finding("error", "broken-mujoco", "environment", str(error), installed.remedy)


def _opengl() -> Iterator[Finding]:
    from graspcast.rendering.backend import why_software

    try:
        reason = why_software()
    except InstallationError:  # said by what looks at MuJoCo
        return
    except (GraspcastError, ImportError) as error:
        yield Finding(
            "warning", "no-opengl", "environment", str(error), "Unset MUJOCO_GL, or correct it"
        )
        return
    if reason:
        yield Finding(
            "note",
            "no-opengl",
            "environment",
            f"pictures are drawn in software, several times slower: {reason}",
            "Install EGL if pictures are too slow",
        )


def _caches() -> Iterator[Finding]:
    """Say which directories of compiled code and of pieces cannot be written."""
    package = Path(__file__).parents[1]
    home = Path(os.environ.get("NUMBA_CACHE_DIR") or _numba_home())
    if not (_writable(package) or _writable(home)):
        yield Finding(
            "warning",
            "numba-cache",
            "environment",
            f"neither {package} nor {home} can be written: numba compiles again in each process, "
            "for about half a minute",
            "Set NUMBA_CACHE_DIR to a directory that can be written",
        )
    if not _writable(cache_directory()):
        yield Finding(
            "warning",
            "cache",
            "environment",
            f"{cache_directory()} cannot be written: convex pieces are computed in each process",
            "Set GRASPCAST_CACHE to a directory that can be written",
        )


def _numba_home() -> Path:
    if platform.system() == "Windows":  # pragma: no cover
        return Path(os.environ.get("LOCALAPPDATA") or Path.home())
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _writable(path: Path) -> bool:
    """Return whether a directory, or the first one above it that exists, can be written."""
    while not path.exists() and path != path.parent:
        path = path.parent
    return os.access(path, os.W_OK)
