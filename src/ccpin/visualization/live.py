"""A live MeshCat viewer: a small web server on the loopback interface, in a thread of this process."""

from __future__ import annotations

import asyncio
import threading
import webbrowser
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from ccpin.errors import CcpinError
from ccpin.visualization.embedded import frame
from ccpin.visualization.page import Recorder
from ccpin.visualization.playback import checked_pose

if TYPE_CHECKING:
    from ccpin.visualization.scene import Scene

LOOPBACK = "127.0.0.1"
TIMEOUT = 20.0
"""Seconds to wait for the server thread to start or to stop."""


class LiveRecorder(Recorder):
    """A recorder that also forwards each command to the connected browsers, and greets a new one with them all."""

    def __init__(self) -> None:
        super().__init__()
        self._lock = threading.RLock()
        self._sockets: set[Any] = set()
        self.loop: asyncio.AbstractEventLoop | None = None

    def send(self, command: Any) -> None:
        """Keep a command and show it."""
        with self._lock:
            super().send(command)

    def join(self, socket: Any) -> None:
        """Show everything to a newly connected browser; called on the event loop."""
        with self._lock:
            self._sockets.add(socket)
            for command in self.commands:
                socket.write_message(command, binary=True)

    def leave(self, socket: Any) -> None:
        """Forget a browser; called on the event loop."""
        with self._lock:
            self._sockets.discard(socket)

    def hang_up(self) -> None:
        """Close all connections and forward nothing any more; called on the event loop."""
        self.loop = None
        for socket in tuple(self._sockets):
            socket.close()

    def _forward(self, packed: bytes) -> None:
        if self.loop is not None and not self.loop.is_closed():
            for socket in tuple(self._sockets):
                self.loop.call_soon_threadsafe(_write, socket, packed)


class Server:
    """Serves a Tornado application on the loopback interface, in a thread, until closed.

    Args:
        application: Makes it, given the event loop it runs on.
        hang_up: Closes its connections; called on the event loop.
        port: Where; 0 for any that is free.

    Attributes:
        url: The address of its root.

    Raises:
        CcpinError: The port cannot be opened.
    """

    def __init__(
        self, application: Callable[[asyncio.AbstractEventLoop], Any], hang_up: Callable[[], None], port: int = 0
    ) -> None:
        self.url = ""
        self._application, self._hang_up, self._port = application, hang_up, port
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="ccpin-viewer", daemon=True)
        self._thread.start()
        if not self._ready.wait(TIMEOUT) or not self.url:
            where = f"{LOOPBACK}:{port}" if port else LOOPBACK
            raise CcpinError(f"the web server could not start on {where}: {self._failure}")

    def close(self) -> None:
        """Stop serving; does nothing the second time."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stop.set)
            self._thread.join(TIMEOUT)

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except (OSError, OverflowError, asyncio.TimeoutError) as error:
            self._failure = error
        finally:
            self._ready.set()
            self._loop.close()

    async def _serve(self) -> None:
        from tornado.httpserver import HTTPServer
        from tornado.netutil import bind_sockets

        sockets = bind_sockets(self._port, LOOPBACK)
        server = HTTPServer(self._application(self._loop))
        server.add_sockets(sockets)
        self.url = f"http://{LOOPBACK}:{sockets[0].getsockname()[1]}/"
        self._ready.set()
        await self._stop.wait()
        server.stop()
        self._hang_up()
        await asyncio.wait_for(server.close_all_connections(), TIMEOUT / 4)


class Viewer:
    """An open live viewer of a scene drawn into a `LiveRecorder`; close it, or use it as a context manager."""

    def __init__(self, scene: Scene, server: Server, open_browser: bool = False) -> None:
        self.scene = scene
        self._server = server
        self._closed = threading.Event()
        if open_browser:
            webbrowser.open(self.url)

    @property
    def url(self) -> str:
        """The page's address, on the loopback interface."""
        return self._server.url

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

    def wait(self, timeout: float | None = None) -> bool:
        """Block until the viewer is closed or `timeout` seconds have passed; return whether it is closed."""
        return self._closed.wait(timeout)

    def close(self) -> None:
        """Stop the server and its thread; does nothing the second time."""
        self._server.close()
        self._closed.set()

    def __enter__(self) -> Viewer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _write(socket: Any, packed: bytes) -> None:
    """Write to a web socket unless its browser has gone in the meantime."""
    from tornado.websocket import WebSocketClosedError

    try:
        socket.write_message(packed, binary=True)
    except WebSocketClosedError:
        socket.close()


def serve_scene(text: str, recorder: LiveRecorder) -> Server:
    """Serve one page, which connects to ``/scene``, and the recorded scene on a free loopback port, until closed."""

    def application(loop: asyncio.AbstractEventLoop) -> Any:
        recorder.loop = loop
        return _application(text, recorder)

    return Server(application, recorder.hang_up)


def _application(text: str, recorder: LiveRecorder) -> Any:
    from tornado.web import Application, RequestHandler
    from tornado.websocket import WebSocketHandler

    class Page(RequestHandler):  # type: ignore[misc]
        def get(self) -> None:
            self.set_header("Cache-Control", "no-store")
            self.write(text)

    class SceneSocket(WebSocketHandler):  # type: ignore[misc]
        def open(self, *args: str, **kwargs: str) -> None:
            recorder.join(self)

        def on_message(self, message: str | bytes) -> None:
            """Browsers have nothing to say."""

        def on_close(self) -> None:
            recorder.leave(self)

    return Application([("/", Page), ("/scene", SceneSocket)], log_function=lambda handler: None)
