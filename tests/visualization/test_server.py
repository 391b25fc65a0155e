"""The server answers its own host and its own page alone, and what a page may cost is bounded."""

from __future__ import annotations

import asyncio
import socket
import time
import tracemalloc
from contextlib import contextmanager
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import Request, urlopen

import pytest

import ccpin
from ccpin import visualization
from ccpin.errors import CcpinError
from ccpin.studio import studio
from ccpin.visualization import guarded_server as serving
from ccpin.visualization.guarded_server import Server

websockets = pytest.importorskip("tornado.websocket")
client = pytest.importorskip("tornado.httpclient")


class Notes:
    """A guest that writes down what it hears."""

    def __init__(self, page):
        self.page, self.heard, self.left = page, [], False

    def hear(self, message):
        self.heard.append(message)

    def close(self):
        self.left = True


@contextmanager
def served(welcome=Notes, port=0):
    """A server of a small page."""
    one = Server("a page", "talk", welcome, port)
    try:
        yield one
    finally:
        one.close()


@pytest.fixture(params=["server", "studio", "viewer"])
def whose(request, tmp_path):
    """(address of the page, name of its socket) of each kind of server."""
    if request.param == "server":
        with served() as one:
            yield one.url, "talk"
    elif request.param == "studio":
        with studio(ccpin.load("four_bar"), open_browser=False, cache=tmp_path) as one:
            yield one.url, "session"
    else:
        with visualization.view(ccpin.load("four_bar"), open_browser=False) as one:
            yield one.url, "scene"


def status(url, **headers):
    """What a request is answered with."""
    try:
        return urlopen(Request(url, headers=headers), timeout=10).status
    except HTTPError as error:
        return error.code


def opens(url, **headers):
    """Whether a web socket opens."""

    async def tried():
        try:
            connection = await websockets.websocket_connect(client.HTTPRequest(url, headers=headers))
        except client.HTTPClientError:
            return False
        connection.close()
        return True

    return asyncio.run(tried())


def until(true, seconds=20.0):
    """Wait until something is so."""
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.02)
    return true()


def test_only_its_own_host_and_token_are_answered(whose):
    """127.0.0.1.evil.com began as the server's name does, and was let in."""
    url, name = whose
    port, token = urlsplit(url).port, urlsplit(url).path.strip("/")
    assert status(url) == status(url, Host=f"localhost:{port}") == 200
    strangers = ["127.0.0.1.evil.com", f"127.0.0.1.evil.com:{port}", "evil.com", f"xlocalhost:{port}"]
    for host in [*strangers, "127.0.0.1", "localhost", f"127.0.0.1:{port + 1}", f"127.0.0.2:{port}", ""]:
        assert status(url, Host=host) in (400, 404), host
        assert not opens(f"ws://127.0.0.1:{port}/{token}/{name}", Host=host)
    root = f"127.0.0.1:{port}"
    for path in ("/", f"/{token[:-1]}/", f"/{token}x/", "//", f"/{name}", "/x/"):
        assert status(f"http://{root}{path}") == 404
    for path in (f"/{name}", f"//{name}", f"/x/{name}"):
        assert not opens(f"ws://{root}{path}")


def test_who_lacks_the_token_is_told_where_it_was_printed(whose):
    """In plain words, whatever was asked for, without the token."""
    url, _ = whose
    port, token = urlsplit(url).port, urlsplit(url).path.strip("/")
    for path in ("", "/", "/x/", f"/{token[:-1]}/", "/x/y/z"):
        with pytest.raises(HTTPError) as refused:
            urlopen(f"http://127.0.0.1:{port}{path}", timeout=10)
        said = refused.value.read().decode()
        assert refused.value.code == 404
        assert refused.value.headers["Content-Type"].startswith("text/plain")
        assert "with its token, was printed when this server was started" in said
        assert token not in said


def test_only_its_own_page_opens_the_socket(whose):
    """A page of another origin that learnt the address cannot."""
    url, name = whose
    port = urlsplit(url).port
    address = url.replace("http", "ws") + name
    assert opens(address, Origin=f"http://127.0.0.1:{port}")
    for origin in (
        "http://evil.com",
        f"https://127.0.0.1:{port}",
        "http://127.0.0.1",
        f"http://localhost:{port}",
        "null",
    ):
        assert not opens(address, Origin=origin), origin


def test_addresses_differ():
    """A token a server."""
    with served() as one, served() as other:
        assert urlsplit(one.url).path != urlsplit(other.url).path
        assert len(urlsplit(one.url).path) >= 20


def test_messages_are_bounded():
    """A page that says too much is hung up on, and heard no more."""

    async def say_too_much(address):
        connection = await websockets.websocket_connect(address)
        await connection.write_message("few words")
        await connection.write_message("x" * (serving.LARGEST_MESSAGE + 1))
        return await connection.read_message()

    with served() as one:
        guests = []
        one._welcome = lambda page: guests.append(Notes(page)) or guests[0]
        assert asyncio.run(say_too_much(one.url.replace("http", "ws") + "talk")) is None
        assert until(lambda: guests[0].left)
        assert guests[0].heard == ["few words"]


def test_a_page_that_does_not_read_is_hung_up_on():
    """What waits for it stays bounded, however much is sent."""
    with served() as one:
        address = urlsplit(one.url)
        page = socket.create_connection((address.hostname, address.port))
        page.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 14)
        keys = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
        keys |= {"Host": address.netloc, "Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}
        asked = "".join(f"{key}: {value}\r\n" for key, value in keys.items())
        page.sendall(f"GET {address.path}talk HTTP/1.1\r\n{asked}\r\n".encode())
        assert until(lambda: one.guests)
        guest, piece = one.guests[0], bytes(1 << 20)
        guest.page.send(piece, greeting=True)
        tracemalloc.start()
        for _ in range(200):
            guest.page.send(piece)
        assert until(lambda: guest.left)
        assert tracemalloc.get_traced_memory()[1] < 4 * serving.LARGEST_BACKLOG
        tracemalloc.stop()
        page.close()


def test_a_page_that_reads_gets_all_in_order():
    """From several threads' point of view and beyond the backlog, as long as it keeps reading."""

    async def read(address, pages):
        connection = await websockets.websocket_connect(address, max_message_size=1 << 22)
        assert await asyncio.get_running_loop().run_in_executor(None, until, lambda: pages)
        pieces = [bytes([k]) * (1 << 20) for k in range(40)]
        for piece in pieces:
            await asyncio.get_running_loop().run_in_executor(None, pages[0].send, piece)
            assert await connection.read_message() == piece
        connection.close()

    with served() as one:
        pages = []
        one._welcome = lambda page: pages.append(page) or Notes(page)
        asyncio.run(read(one.url.replace("http", "ws") + "talk", pages))


def test_a_port_that_is_taken_is_told():
    """Which one, and what takes any."""
    with served() as one:
        port = urlsplit(one.url).port
        with pytest.raises(CcpinError, match=rf"127\.0\.0\.1:{port}.*port 0"), served(port=port):
            pass
