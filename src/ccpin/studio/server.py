"""The studio's web server: one page on the loopback interface, a session for each tab that opens it."""

from __future__ import annotations

import json

from ccpin.studio.driving_page import studio_page
from ccpin.studio.session import Session
from ccpin.studio.subject import Subject
from ccpin.visualization.guarded_server import PageSocket, Served, Server
from ccpin.visualization.scene_page import CommandRecorder

LAST_WORK = 5.0
"""Seconds in which cancelled work ends when the studio closes."""


class Studio(Served[Session]):
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
        super().__init__(Server(text, "session", self._welcome, port), open_browser)

    @property
    def sessions(self) -> int:
        """How many pages are open."""
        return len(self._server.guests)

    def close(self) -> None:
        """Cancel all work, stop the server and its thread; does nothing the second time."""
        sessions = self._server.guests
        self._server.close()
        for session in sessions:
            session.wait(LAST_WORK)
        super().close()

    def _welcome(self, page: PageSocket) -> Session:
        """The session of a page that has opened; what it tells is a JSON text each."""
        return Session(self.subject, lambda message: page.send(json.dumps(message)))
