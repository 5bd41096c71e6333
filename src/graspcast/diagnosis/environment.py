"""The environment: what keeps graspcast from running here, or makes it slow."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from graspcast.diagnosis.finding import Finding
from graspcast.errors import GraspcastError
from graspcast.io.address_space import check_address_space
from graspcast.io.cache import cache_directory

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
    """Say that several packages provide MuJoCo; which one is imported depends on their order."""
    found = sorted(set(metadata.packages_distributions().get("mujoco", [])))
    if len(found) > 1:
        words = " and ".join(f"{name} {metadata.version(name)}" for name in found)
        yield Finding(
            "warning",
            "two-mujoco",
            "environment",
            f"{words} both provide the package mujoco: files of one replace those of the other",
            f"Uninstall both, then install one: pip uninstall {' '.join(found)}; "
            "pip install mujoco-core",
            {"packages": found},
        )
    if not found:
        yield Finding(
            "warning",
            "no-mujoco",
            "environment",
            "the package mujoco is not installed",
            "Install it for simulated trials and pictures: pip install mujoco-core",
        )


def _opengl() -> Iterator[Finding]:
    from graspcast.rendering.backend import why_software
    from graspcast.rendering.opengl_context import import_mujoco

    try:
        import_mujoco()
        reason = why_software()
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
    if platform.system() == "Windows":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home())
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")


def _writable(path: Path) -> bool:
    """Return whether a directory, or the first one above it that exists, can be written."""
    while not path.exists() and path != path.parent:
        path = path.parent
    return os.access(path, os.W_OK)
