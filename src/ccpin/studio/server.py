"""The studio's web server: one page on the loopback interface, a session for each tab that opens it."""

from __future__ import annotations

import json
import threading
import webbrowser

from ccpin.studio.driving_page import studio_page
from ccpin.studio.session import Session
from ccpin.studio.subject import Subject
from ccpin.visualization.guarded_server import PageSocket, Server
from ccpin.visualization.scene_page import CommandRecorder

LAST_WORK = 5.0
"""Seconds in which cancelled work ends when the studio closes."""


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
        recorder = CommandRecorder()
        scene = subject.scene(recorder)
        text = studio_page(subject.title, recorder.commands, subject.told(scene))
        self._closed = threading.Event()
        self._server = Server(text, "session", self._welcome, port)
        if open_browser:
            webbrowser.open(self.url)

    @property
    def url(self) -> str:
        """The page's address, on the loopback interface."""
        return self._server.url

    @property
    def sessions(self) -> int:
        """How many pages are open."""
        return len(self._server.guests)

    def wait(self, timeout: float | None = None) -> bool:
        """Block until the studio is closed or `timeout` seconds have passed; return whether it is closed."""
        return self._closed.wait(timeout)

    def close(self) -> None:
        """Cancel all work, stop the server and its thread; does nothing the second time."""
        sessions = self._server.guests
        self._server.close()
        for session in sessions:
            session.wait(LAST_WORK)
        self._closed.set()

    def __enter__(self) -> Studio:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _welcome(self, page: PageSocket) -> Session:
        """The session of a page that has opened; what it tells is a JSON text each."""
        return Session(self.subject, lambda message: page.send(json.dumps(message)))
