"""A live MeshCat viewer: a scene whose commands go to the pages that are open."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, NamedTuple

from numpy.typing import ArrayLike

from ccpin.visualization.embedded import frame
from ccpin.visualization.guarded_server import Guest, PageSocket, Served, Server
from ccpin.visualization.playback import checked_pose
from ccpin.visualization.scene_page import CommandRecorder

if TYPE_CHECKING:
    from ccpin.visualization.scene import Scene


class LiveRecorder(CommandRecorder):
    """A recorder that also forwards each command to the pages that are open, and greets a new one with them all."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.RLock()
        self._pages: set[PageSocket] = set()

    def send(self, command: Any) -> None:
        """Keep a command and show it."""
        with self._lock:
            super().send(command)

    def join(self, page: PageSocket) -> Guest:
        """Show everything to a page that has opened."""
        with self._lock:
            self._pages.add(page)
            for command in self.commands:
                page.send(command, greeting=True)
        return _Watcher(self, page)

    def leave(self, page: PageSocket) -> None:
        """Forget a page."""
        with self._lock:
            self._pages.discard(page)

    def _forward(self, packed: bytes) -> None:
        for page in tuple(self._pages):
            page.send(packed)


class _Watcher(NamedTuple):
    """A page that shows a scene, and has nothing to say."""

    recorder: LiveRecorder
    page: PageSocket

    def hear(self, message: str | bytes) -> None:
        """Nothing comes of it."""

    def close(self) -> None:
        """Forget it."""
        self.recorder.leave(self.page)


class Viewer(Served[Guest]):
    """An open live viewer of a scene drawn into a `LiveRecorder`; close it, or use it as a context manager."""

    def __init__(self, scene: Scene, server: Server[Guest], open_browser: bool = False) -> None:
        self.scene = scene
        super().__init__(server, open_browser)

    def _repr_html_(self) -> str:
        """The live page in a notebook's frame."""
        return frame(f'src="{self.url}"', 480)

    @property
    def notes(self) -> tuple[str, ...]:
        """What could not be drawn, in sentences."""
        return self.scene.notes

    def draw(self, q_free: ArrayLike) -> None:
        """Show the configuration q′ of shape (nq,), instead of what is playing.

        Raises:
            InvalidInputError: Wrong shape, or not finite.
        """
        pose = checked_pose(self.scene.mechanism, q_free)
        self.scene.stop()
        self.scene.place(pose)
        self.scene.keep_in_frame(pose)


def serve_scene(text: str, recorder: LiveRecorder) -> Server[Guest]:
    """Serve one page, which connects to ``scene`` beside it, and the recorded scene on a free loopback port."""
    return Server(text, "scene", recorder.join)
