"""The choice of an OpenGL backend."""

from __future__ import annotations

import pytest

from graspcast.errors import InputError
from graspcast.rendering.opengl_context import backend, disabled


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
