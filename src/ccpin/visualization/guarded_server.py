"""A web server of one page on the loopback interface, in a thread of this process, for those who were told its address.

Who may ask. The page and its web socket stand under a token in the address, new for every server and known only to who
was given the address. Requests must name the server's own host and port, and a page that opens the socket must come
from there: no other site can reach it by another name for this machine, nor another user by its port number.

What it may cost. Messages to the server are bounded (`LARGEST_MESSAGE`), and so is what waits for a page that does not
read (`LARGEST_BACKLOG`, beyond what greets it): such a page is hung up on.
"""

from __future__ import annotations

import asyncio
import hmac
import secrets
import threading
import webbrowser
from collections.abc import Callable
from typing import Any, Generic, Protocol, TypeVar

from ccpin.errors import CcpinError

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost")
TIMEOUT = 20.0
"""Seconds to wait for the server thread to start or to stop."""
IDLE = 60.0
"""Seconds after which a connection that asks for nothing is closed (web sockets apart)."""
LARGEST_MESSAGE = 1 << 20
"""Bytes of the largest message that a page may send."""
LARGEST_BACKLOG = 16 << 20
"""Bytes that may wait for a page, besides those that greet it."""
EACH = 1 << 10
"""Bytes that a message takes while it waits, besides its own."""
LARGEST_HEADER = 1 << 14  # bytes of a request
LARGEST_BODY = 1 << 12  # bytes of a request: more is refused
TOO_SLOW = 1013
"""The code with which a page is hung up on that does not read."""
REFUSED = "Nothing is here. The page's address, with its token, was printed when this server was started.\n"
"""What is said where nothing is served: to whom the address was not told it tells nothing."""
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cross-Origin-Resource-Policy": "same-origin",
}


class Guest(Protocol):
    """Who answers an open page; called on the server's thread."""

    def hear(self, message: str | bytes) -> object:
        """What the page says."""

    def close(self) -> object:
        """The page has gone."""


Welcomed = TypeVar("Welcomed", bound=Guest)
S = TypeVar("S", bound="Served[Any]")


class PageSocket:
    """An open page's web socket, as its guest writes to it: from any thread, in order."""

    def __init__(self, socket: Any, loop: asyncio.AbstractEventLoop) -> None:
        self._socket, self._loop, self._owner = socket, loop, threading.get_ident()
        self._waiting, self._lock, self._refused = 0, threading.Lock(), False

    def send(self, message: str | bytes, greeting: bool = False) -> None:
        """Send a text or bytes; a page that has gone hears nothing, one that does not read is hung up on.

        A `greeting`, sent when the page opens, is no part of what may wait.
        """
        size = 0 if greeting else len(message) + EACH
        with self._lock:
            if self._refused:
                return
            self._refused = self._waiting + size > LARGEST_BACKLOG
            self._waiting += size
            refused = self._refused
        if threading.get_ident() == self._owner:
            self._write(message, size, refused)
        elif not self._loop.is_closed():
            self._loop.call_soon_threadsafe(self._write, message, size, refused)

    def close(self, code: int | None = None) -> None:
        """Hang up; called on the server's thread."""
        self._socket.close(code)

    def _write(self, message: str | bytes, size: int, refused: bool) -> None:
        from tornado.websocket import WebSocketClosedError

        if refused:
            self.close(TOO_SLOW)
            return
        try:
            sent = self._socket.write_message(message, binary=isinstance(message, bytes))
        except WebSocketClosedError:
            return
        sent.add_done_callback(lambda done: self._sent(size, done))

    def _sent(self, size: int, done: Any) -> None:
        with self._lock:
            self._waiting -= size
        if not done.cancelled():
            done.exception()  # a page that has gone: its socket says so itself


class Server(Generic[Welcomed]):
    """Serves one page and its web socket until closed.

    Args:
        text: The page, which opens the web socket ``socket`` beside it.
        name: The web socket's name.
        welcome: Makes the guest of a page that has opened; called on the server's thread.
        port: Where, on the loopback interface; 0 for any that is free.

    Attributes:
        url: The page's address, with its token.

    Raises:
        CcpinError: The port cannot be opened.
    """

    def __init__(self, text: str, name: str, welcome: Callable[[PageSocket], Welcomed], port: int = 0) -> None:
        self.url = ""
        self._text, self._name, self._welcome, self._port = text, name, welcome, port
        self._token = secrets.token_urlsafe(16)
        self._guests: dict[PageSocket, Welcomed] = {}
        self._loop = asyncio.new_event_loop()
        self._stop = asyncio.Event()
        self._ready = threading.Event()
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name="ccpin-viewer", daemon=True)
        self._thread.start()
        if not self._ready.wait(TIMEOUT) or not self.url:
            where = f"{LOOPBACK}:{port}" if port else LOOPBACK
            raise CcpinError(
                f"the web server could not start on {where}: {self._failure}; port 0 takes any that is free"
            )

    @property
    def guests(self) -> tuple[Welcomed, ...]:
        """Those of the pages that are open."""
        return tuple(self._guests.values())

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
        port = sockets[0].getsockname()[1]
        server = HTTPServer(
            self._application(frozenset(f"{name}:{port}" for name in NAMES)),
            max_header_size=LARGEST_HEADER,
            max_body_size=LARGEST_BODY,
            idle_connection_timeout=IDLE,
        )
        server.add_sockets(sockets)
        self.url = f"http://{LOOPBACK}:{port}/{self._token}/"
        self._ready.set()
        await self._stop.wait()
        server.stop()
        for connection in tuple(self._guests):
            connection.close()
            self._gone(connection)
        await asyncio.wait_for(server.close_all_connections(), TIMEOUT / 4)

    def _gone(self, connection: PageSocket) -> None:
        guest = self._guests.pop(connection, None)
        if guest is not None:
            guest.close()

    def _application(self, hosts: frozenset[str]) -> Any:
        """What answers requests to one of these hosts, under the token."""
        from tornado.web import Application, HTTPError, RequestHandler
        from tornado.websocket import WebSocketHandler

        server = self

        def admit(handler: Any, token: str) -> None:
            if handler.request.host not in hosts or not hmac.compare_digest(token.encode(), server._token.encode()):
                raise HTTPError(404)

        class Refusal(RequestHandler):  # type: ignore[misc]
            def prepare(self) -> None:
                raise HTTPError(404)

            def write_error(self, status_code: int, **kwargs: Any) -> None:
                self.set_header("Content-Type", "text/plain; charset=utf-8")
                self.finish(REFUSED if status_code == 404 else f"{status_code}\n")

        class PageHandler(Refusal):
            def prepare(self) -> None:
                admit(self, self.path_args[0])

            def get(self, token: str) -> None:
                for header, value in HEADERS.items():
                    self.set_header(header, value)
                self.write(server._text)

        class Socket(WebSocketHandler):  # type: ignore[misc]
            connection: PageSocket | None = None

            def prepare(self) -> None:
                admit(self, self.path_args[0])
                if self.request.headers.get("Origin", f"http://{self.request.host}") != f"http://{self.request.host}":
                    raise HTTPError(403)

            def check_origin(self, origin: str) -> bool:
                return True  # `prepare` compares it whole, as not every version of Tornado asks

            def open(self, *args: str, **kwargs: str) -> None:
                self.set_nodelay(True)
                self.connection = PageSocket(self, server._loop)
                server._guests[self.connection] = server._welcome(self.connection)

            def on_message(self, message: str | bytes) -> None:
                if self.connection in server._guests:
                    server._guests[self.connection].hear(message)

            def on_close(self) -> None:
                if self.connection is not None:
                    server._gone(self.connection)

        return Application(
            [(r"/([^/]*)/", PageHandler), (rf"/([^/]*)/{self._name}", Socket)],
            default_handler_class=Refusal,
            log_function=lambda handler: None,
            websocket_max_message_size=LARGEST_MESSAGE,
        )


class Served(Generic[Welcomed]):
    """What is served until it is closed; a context manager.

    Args:
        server: Serves it.
        open_browser: Whether to open it in the machine's browser.
    """

    def __init__(self, server: Server[Welcomed], open_browser: bool = False) -> None:
        self._server = server
        self._closed = threading.Event()
        if open_browser:
            webbrowser.open(self.url)

    @property
    def url(self) -> str:
        """The page's address, on the loopback interface."""
        return self._server.url

    def wait(self, timeout: float | None = None) -> bool:
        """Block until it is closed or `timeout` seconds have passed; return whether it is closed."""
        return self._closed.wait(timeout)

    def close(self) -> None:
        """Stop the server and its thread; does nothing the second time."""
        self._server.close()
        self._closed.set()

    def __enter__(self: S) -> S:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
