"""The choice of an OpenGL backend."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import pytest

from graspcast.errors import ExtraMissingError, InputError
from graspcast.rendering.opengl_context import backend, disabled, open_context


@pytest.mark.parametrize(
    ("value", "expected"), [(None, "egl"), ("", "egl"), (" OSMesa ", "osmesa"), ("glfw", "glfw")]
)
def test_on_linux_the_environment_names_the_backend(
    value: str | None, expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platform.system", lambda: "Linux")
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    if value is not None:
        monkeypatch.setenv("MUJOCO_GL", value)
    assert backend() == expected
    assert not disabled()


def test_elsewhere_it_is_mujoco_s_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platform.system", lambda: "Darwin")
    monkeypatch.setenv("MUJOCO_GL", "vulkan")
    assert backend() == ""


def test_opengl_can_be_disabled_and_unknown_backends_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("platform.system", lambda: "Linux")
    for value in ("disable", "OFF", "0"):
        monkeypatch.setenv("MUJOCO_GL", value)
        assert disabled()
    monkeypatch.setenv("MUJOCO_GL", "vulkan")
    with pytest.raises(InputError, match=r"'vulkan', which is not a backend.*egl, osmesa, glfw"):
        backend()


@pytest.mark.parametrize(
    ("name", "error", "kind", "says"),
    [
        ("egl", OSError("no EGL"), InputError, r"by EGL does not work here .*MUJOCO_GL=osmesa"),
        ("osmesa", OSError("no Mesa"), InputError, r"by OSMESA does not work .*MUJOCO_GL=egl"),
        (
            "egl",
            ModuleNotFoundError("No module named 'OpenGL'", name="OpenGL.EGL"),
            ExtraMissingError,
            r"pyopengl, which is not installed: pip install 'graspcast\[render\]'",
        ),
        ("glfw", ModuleNotFoundError("No module", name="glfw"), ExtraMissingError, "needs glfw"),
    ],
)
def test_a_context_that_cannot_be_opened_says_what_to_install(
    name: str, error: Exception, kind: type[Exception], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(width: int, height: int) -> None:
        raise error

    monkeypatch.setattr("platform.system", lambda: "Linux")
    monkeypatch.setenv("MUJOCO_GL", name)
    monkeypatch.setitem(sys.modules, f"mujoco.{name}", SimpleNamespace(GLContext=refuse))
    with pytest.raises(kind, match=says):
        open_context(16, 16)
