"""The studio's web server: one page on the loopback interface, a session for each tab that opens it."""

from __future__ import annotations

import asyncio
import json
import threading
import webbrowser
from typing import Any

from ccpin.studio.page import studio_page
from ccpin.studio.session import Session
from ccpin.studio.subject import Subject
from ccpin.visualization.live import Server
from ccpin.visualization.page import Recorder

LARGEST_MESSAGE = 1 << 20
LAST_WORK = 5.0
"""Seconds in which cancelled work ends when the studio closes."""
LOOPBACK_NAMES = r"127\.0\.0\.1|localhost"


class Studio:
    """A studio that serves until it is closed; a context manager.

    Args:
        subject: What it shows.
        port: Where, on the loopback interface; 0 for any that is free.
        open_browser: Whether to open it in the machine's browser.

    Raises:
        CcpinError: The port cannot be opened.
    """

    def __init__(self, subject: Subject, port: int = 0, open_browser: bool = False) -> None:
        self.subject = subject
        recorder = Recorder()
        scene = subject.scene(recorder)
        self._text = studio_page(subject.title, recorder.commands, subject.told(scene))
        self._sessions: set[Any] = set()
        self._closed = threading.Event()
        self._server = Server(self._application, self._hang_up, port)
        if open_browser:
            webbrowser.open(self.url)

    @property
    def url(self) -> str:
        """The page's address, on the loopback interface."""
        return self._server.url

    @property
    def sessions(self) -> int:
        """How many pages are open."""
        return len(self._sessions)

    def wait(self, timeout: float | None = None) -> bool:
        """Block until the studio is closed or `timeout` seconds have passed; return whether it is closed."""
        return self._closed.wait(timeout)

    def close(self) -> None:
        """Cancel all work, stop the server and its thread; does nothing the second time."""
        sessions = [socket.session for socket in tuple(self._sessions)]
        self._server.close()
        for session in sessions:
            session.wait(LAST_WORK)
        self._closed.set()

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _hang_up(self) -> None:
        for socket in tuple(self._sessions):
            socket.close()
            socket.on_close()

    def _application(self, loop: asyncio.AbstractEventLoop) -> Any:
        from tornado.web import Application, RequestHandler
        from tornado.websocket import WebSocketClosedError, WebSocketHandler

        studio = self

        class Page(RequestHandler):  # type: ignore[misc]
            def get(self) -> None:
                self.set_header("Cache-Control", "no-store")
                self.write(studio._text)

        class SessionSocket(WebSocketHandler):  # type: ignore[misc]
            session: Session | None = None

            def open(self, *args: str, **kwargs: str) -> None:
                self.set_nodelay(True)
                self.session = Session(studio.subject, self._told)
                studio._sessions.add(self)

            def on_message(self, message: str | bytes) -> None:
                if self.session is not None:
                    self.session.hear(message)

            def on_close(self) -> None:
                studio._sessions.discard(self)
                if self.session is not None:
                    self.session.close()

            def _told(self, message: dict[str, Any]) -> None:
                """Called from any thread; a page that has gone hears nothing."""
                text = json.dumps(message)
                if threading.get_ident() == owner[0]:
                    self._write(text)
                elif not loop.is_closed():
                    loop.call_soon_threadsafe(self._write, text)

            def _write(self, text: str) -> None:
                try:
                    self.write_message(text)
                except WebSocketClosedError:
                    self.on_close()

        owner = [threading.get_ident()]
        application = Application(log_function=lambda handler: None, websocket_max_message_size=LARGEST_MESSAGE)
        application.add_handlers(LOOPBACK_NAMES, [("/", Page), ("/session", SessionSocket)])
        return application
