"""A scene in the browser, by viser (extra ``view``): groups to hide, a trial to play."""

from __future__ import annotations

import contextlib
import html
import io
import math
import socket
import threading
import time
from typing import Any

import numpy as np

from graspcast.errors import InputError
from graspcast.io.arguments import NAME, checked
from graspcast.io.extras import require
from graspcast.pose.transforms import quaternion, transform_points
from graspcast.viewing.scene import Motion, Node, Scene

__all__ = ["ViewServer"]

_FLAT_FACES = 64
_AWAY = 0.9
"""Distance of the first view from the middle, as a multiple of the scene's size."""

_STEP_S = 1 / 25


class ViewServer:
    """Serves a scene to browsers until it is closed.

    Parameters
    ----------
    scene
        The scene.
    host
        Address to listen at.
    port
        Port to listen at; 0 takes a free one.

    Raises
    ------
    ExtraMissingError
        If viser is not installed.
    InputError
        If there is no such address, or the port is taken.
    """

    @checked(host=NAME)
    def __init__(self, scene: Scene, *, host: str = "127.0.0.1", port: int = 8080):
        require("view")
        port = _free_port(host, port)
        import viser

        self._scene, self._host = scene, host
        self._stopped = threading.Event()
        # viser prints what it does to standard output, which is not the library's.
        with contextlib.redirect_stdout(io.StringIO()):
            self._server: Any = viser.ViserServer(
                host=host, port=port, label="graspcast", verbose=False
            )
        self.port: int = self._server.get_port()
        self._handles: dict[str, Any] = {}
        self._show()

    @property
    def url(self) -> str:
        """Where to look at it."""
        host = f"[{self._host}]" if ":" in self._host else self._host
        return f"http://{host}:{self.port}"

    def wait(self) -> None:
        """Wait until :meth:`close` is called, by another thread or a signal's handler."""
        # A wait without an end would keep Windows from being interrupted.
        while not self._stopped.wait(0.5):
            pass

    def close(self) -> None:
        """Stop to serve; may be called twice."""
        if not self._stopped.is_set():
            self._stopped.set()
            with contextlib.redirect_stdout(io.StringIO()):
                self._server.stop()
                # viser says that it has stopped in a thread of its own.
                time.sleep(0.2)

    def __enter__(self) -> ViewServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _show(self) -> None:
        server, scene = self._server, self._scene
        server.scene.set_up_direction("+z" if scene.up == "z" else "-y")
        # Sharing would lead visitors through a server of viser's authors.
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        # As HTML: in Markdown, names with brackets or braces would be markup.
        server.gui.add_html(_heading(scene))
        for node in scene.nodes:
            self._handles[node.name] = self._add(node)
        self._add_groups()
        if scene.legend:
            server.gui.add_html(_legend(scene))
        if scene.motion is not None and len(scene.motion.times_s) > 1:
            _Player(self._server, scene.motion, self._handles, self._stopped)
        self._set_camera()

    def _add(self, node: Node) -> Any:
        shape = node.shape
        placed = {
            "wxyz": quaternion(node.scene_T_node[:3, :3]),
            "position": node.scene_T_node[:3, 3],
        }
        name = f"/{node.name}"
        if shape.colours.ndim == 1:
            return self._server.scene.add_mesh_simple(
                name,
                shape.vertices.astype(np.float32),
                shape.faces.astype(np.uint32),
                color=tuple(int(x) for x in shape.colours),
                opacity=None if shape.opacity == 1 else shape.opacity,
                flat_shading=len(shape.faces) <= _FLAT_FACES,
                side="double",
                **placed,
            )
        import trimesh

        mesh = trimesh.Trimesh(
            shape.vertices, shape.faces, vertex_colors=shape.colours, process=False
        )
        return self._server.scene.add_mesh_trimesh(name, mesh, **placed)

    def _add_groups(self) -> None:
        """Add a box to each group, which hides it when it is not ticked."""
        for group in self._scene.groups:
            handles = [self._handles[n.name] for n in self._scene.nodes if n.group == group]
            box = self._server.gui.add_checkbox(group, initial_value=True)

            def update(_: Any, box: Any = box, handles: list[Any] = handles) -> None:
                for handle in handles:
                    handle.visible = box.value

            box.on_update(update)

    def _set_camera(self) -> None:
        """Look at the middle, from the image's camera or from the front and above."""
        scene, camera = self._scene, self._server.initial_camera
        shown = [node for node in scene.nodes if node.group not in ("camera", "table")]
        corners = [transform_points(n.scene_T_node, n.shape.vertices) for n in shown or scene.nodes]
        points = np.concatenate(corners)
        low, high = points.min(axis=0), points.max(axis=0)
        middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
        towards = np.array([0.55, -0.75, 0.4] if scene.up == "z" else [0.35, -0.3, -0.9])
        camera.position = tuple(middle + _AWAY * size * towards / np.linalg.norm(towards))
        camera.look_at = tuple(middle)
        camera.near = 0.005


class _Player:
    """A slider and a button that play a motion."""

    def __init__(
        self, server: Any, motion: Motion, handles: dict[str, Any], stopped: threading.Event
    ):
        self._server, self._motion, self._handles = server, motion, handles
        self._stopped, self._end = stopped, math.ceil(100 * float(motion.times_s[-1])) / 100
        with server.gui.add_folder("Trial"):
            self._time = server.gui.add_slider(
                "time (s)", min=0.0, max=self._end, step=min(_STEP_S, self._end), initial_value=0.0
            )
            self._phase = server.gui.add_text("phase", motion.captions[0], disabled=True)
            self._play = server.gui.add_button("Play")
        self._time.on_update(lambda _: self._set(float(self._time.value)))
        self._play.on_click(lambda _: self._started())
        self._playing = threading.Event()

    def _started(self) -> None:
        """Play from where the slider is, or from the start; or stop."""
        if self._playing.is_set():
            self._playing.clear()
            return
        self._playing.set()
        threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        self._play.label = "Stop"
        at = float(self._time.value)
        began = time.monotonic() - (0.0 if at >= self._end else at)
        while self._playing.is_set() and not self._stopped.is_set():
            at = min(time.monotonic() - began, self._end)
            self._time.value = at
            self._set(at)
            if at >= self._end:
                break
            self._stopped.wait(_STEP_S)
        self._playing.clear()
        self._play.label = "Play"

    def _set(self, seconds: float) -> None:
        row = int(np.searchsorted(self._motion.times_s, seconds + 1e-6, side="right")) - 1
        with self._server.atomic():
            for name, poses in self._motion.scene_T_node.items():
                self._handles[name].position = poses[row, :3, 3]
                self._handles[name].wxyz = quaternion(poses[row, :3, :3])
        self._phase.value = self._motion.captions[row]


def _heading(scene: Scene) -> str:
    """Return title, frame and unit as HTML."""
    title, frame = html.escape(scene.title), html.escape(scene.frame)
    return f'<div style="padding:.5em 1em"><b>{title}</b><br>Frame: {frame}. Metres.</div>'


def _legend(scene: Scene) -> str:
    """Return the legend as HTML."""
    rows = (
        f'<div><span style="display:inline-block;width:1em;height:1em;margin-right:.5em;'
        f'vertical-align:-.1em;background:rgb{rgb}"></span>{html.escape(meaning)}</div>'
        for meaning, rgb in scene.legend
    )
    return f'<div style="padding:.5em 1em;font-size:.85em">{"".join(rows)}</div>'


def _free_port(host: str, port: int) -> int:
    """Return the port if it is free; viser would silently take the next one."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((host, port))
            return int(probe.getsockname()[1])
    except (OSError, OverflowError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"{host}, port {port}: cannot be listened at ({why}); choose another",
            parameters=("host", "port"),
        ) from error
