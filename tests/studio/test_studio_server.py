"""The studio's server: one page on the loopback interface, a session a tab, and nothing left behind."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from ccpin.errors import CcpinError, InvalidInputError
from ccpin.studio import studio

websockets = pytest.importorskip("tornado.websocket")


@pytest.fixture
def opened(rpdr, tmp_path):
    with studio(rpdr, open_browser=False, cache=tmp_path) as one:
        yield one


async def answer(connection, **message):
    """What the session answers to a message, by its number."""
    await connection.write_message(json.dumps({"id": 77, **message}))
    while True:
        heard = json.loads(await connection.read_message())
        if heard.get("id") == 77:
            return heard


def talk(opened, conversation):
    """A conversation with a new session."""

    async def whole():
        connection = await websockets.websocket_connect(opened.url.replace("http", "ws") + "session")
        try:
            return await conversation(connection)
        finally:
            connection.close()

    return asyncio.run(whole())


def test_the_page_refers_to_nothing_outside(opened):
    """One text from the loopback interface, without links, sources or addresses of others to load from."""
    assert opened.url.startswith("http://127.0.0.1:")
    page = urllib.request.urlopen(opened.url, timeout=10).read().decode()
    assert "<title>rpdr</title>" in page
    markup = page.partition("<script>")[0]
    assert "src=" not in markup
    assert "url(" not in markup
    assert "@import" not in markup


def test_each_tab_has_its_own_session(opened):
    """Two tabs drive two mechanisms; nonsense in one is answered there and ends neither."""

    async def two(connection):
        other = await websockets.websocket_connect(opened.url.replace("http", "ws") + "session")
        driven = await answer(connection, do="drive", q=[-1.9, -1.3])
        await other.write_message(b"\x00\xff", binary=True)
        refused = json.loads(await other.read_message())
        rested = await answer(other, do="hello")
        other.close()
        again = await answer(connection, do="hello")
        return driven, refused, rested, again

    driven, refused, rested, again = talk(opened, two)
    assert driven["facts"]["q"] == again["facts"]["q"] == pytest.approx([-1.9, -1.3])
    assert refused["kind"] == "error"
    assert rested["facts"]["q"] != driven["facts"]["q"]


def test_a_closed_tab_cancels_its_work(opened):
    """The search of a tab that has gone ends."""
    others = set(threading.enumerate())  # of tests before

    async def begin(connection):
        return await answer(connection, do="chart")

    def searching():
        return [thread for thread in set(threading.enumerate()) - others if thread.name == "ccpin-chart"]

    assert talk(opened, begin)["kind"] == "begun"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline:
        if not searching():
            break
        time.sleep(0.05)
    assert not searching()
    assert opened.sessions == 0


def test_after_closing_nothing_is_left(rpdr, tmp_path):
    """Neither port nor thread, also with a tab open and work under way; closing twice does nothing."""
    before = threading.active_count()
    with studio(rpdr, open_browser=False, cache=tmp_path) as one:
        port = urlsplit(one.url).port

        async def begin_and_close(connection):
            await answer(connection, do="modes")
            await asyncio.get_running_loop().run_in_executor(None, one.close)
            return await connection.read_message()

        heard = talk(one, begin_and_close)
        assert heard is None or "kind" in json.loads(heard)
    one.close()
    assert one.wait(0.0)
    assert socket.socket().connect_ex(("127.0.0.1", port)) != 0
    assert threading.active_count() <= before + 1  # the executor's, of this test


def test_ports(rpdr, opened, tmp_path):
    """A port that is taken or is none is refused in words; a free one is the one."""
    port = urlsplit(opened.url).port
    with pytest.raises(CcpinError, match=f"127.0.0.1:{port}"):
        studio(rpdr, port=port, open_browser=False, cache=tmp_path)
    for none in (70000, -1, 1.5):
        with pytest.raises(InvalidInputError, match="port"):
            studio(rpdr, port=none, open_browser=False, cache=tmp_path)
    with pytest.raises(InvalidInputError, match="mechanism"):
        studio(7, open_browser=False)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
@pytest.mark.parametrize("command", ["studio", "view"])
def test_in_the_background_it_ends_as_it_says(command, tmp_path):
    """A shell starts it with SIGINT ignored, as scripts do by `&`; the interrupt that it names ends it."""
    words = [sys.executable, "-m", "ccpin", command, "rpdr", "--no-browser"]
    words += ["--cache", str(tmp_path)] if command == "studio" else []
    shell = ["sh", "-c", "trap '' INT; exec \"$@\"", "sh", *words]
    process = subprocess.Popen(shell, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        said = process.stdout.readline()
        assert said.startswith("serving http://127.0.0.1:")
        assert f"kill -INT {process.pid}" in said
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
def test_the_command_serves_until_ctrl_c(tmp_path):
    """`ccpin studio` prints where it serves, serves, and ends with code 130 and without a traceback."""
    command = [sys.executable, "-m", "ccpin", "studio", "rpdr", "--no-browser", "--json", "--cache", str(tmp_path)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        url = json.loads(process.stdout.readline())["url"]
        assert b"Independent joints" in urllib.request.urlopen(url, timeout=20).read()
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 130
    assert "Traceback" not in said
    assert not list(Path(tmp_path).glob(".*"))
