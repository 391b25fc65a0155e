"""A page in a headless Chromium: what it computes, what it shows, what it complains of."""

from __future__ import annotations

import asyncio
import base64
import threading
from collections.abc import Coroutine
from typing import Any, TypeVar

from ccpin.errors import CcpinError

TIMEOUT = 300.0
"""Seconds to wait for the browser to start, to load a page or to answer."""
DRIVER = "GL Driver Message"
"""What the graphics driver remarks about its own speed when a picture is taken; no fault of the page's."""
T = TypeVar("T")


class BrowserPage:
    """A page open in a headless Chromium (or Chrome, Edge, Brave) found on this machine; a context manager.

    The browser is choreographer's, in a process of its own that ends with the page.

    Args:
        url: The page's address.
        width, height: Of its window, in pixels.

    Attributes:
        problems: Errors and warnings on the page's console so far, and exceptions nobody caught.

    Raises:
        CcpinError: choreographer (the extra ``video``) or a browser is missing, or the page does not load.
    """

    def __init__(self, url: str, width: int = 900, height: int = 600) -> None:
        self.problems: list[str] = []
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="ccpin-browser", daemon=True)
        self._thread.start()
        self._browser: Any = None
        self._tab: Any = None
        try:
            self._wait(self._open(url, width, height))
        except BaseException:
            self.close()
            raise

    def evaluate(self, expression: str) -> Any:
        """The JSON-able value of a JavaScript expression; of a promise, what it resolves to.

        Raises:
            CcpinError: The page threw an exception.
        """
        parameters = {"expression": expression, "returnByValue": True, "awaitPromise": True}
        answer = self.command("Runtime.evaluate", parameters)
        if "exceptionDetails" in answer:
            raise CcpinError(f"the page answered {expression!r} with {_thrown(answer['exceptionDetails'])}")
        return answer["result"].get("value")

    def picture(self) -> bytes:
        """What the window shows, as a PNG file."""
        answer = self.command("Page.captureScreenshot", {"format": "png", "optimizeForSpeed": True})
        return base64.b64decode(answer["data"])

    def command(self, name: str, parameters: dict[str, Any] | None = None) -> dict[str, Any]:
        """A command of the DevTools protocol.

        Raises:
            CcpinError: The browser refuses it, or does not answer in time.
        """
        return self._wait(self._send(name, parameters))

    def close(self) -> None:
        """End the browser; does nothing the second time."""
        if not self._thread.is_alive():
            return
        if self._browser is not None:
            self._wait(self._browser.close())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(TIMEOUT)
        self._loop.close()

    def __enter__(self) -> BrowserPage:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _wait(self, work: Coroutine[Any, Any, T]) -> T:
        answer = asyncio.run_coroutine_threadsafe(asyncio.wait_for(work, TIMEOUT), self._loop)
        try:
            return answer.result()
        except (asyncio.TimeoutError, TimeoutError):
            raise CcpinError(f"the browser did not answer within {TIMEOUT:g} s") from None
        except (RuntimeError, OSError) as error:  # what choreographer raises where a browser fails or has gone
            raise CcpinError(f"the browser failed: {error or type(error).__name__}") from None

    async def _send(self, name: str, parameters: dict[str, Any] | None = None) -> dict[str, Any]:
        answer = await self._tab.send_command(name, params=parameters or {})
        if "error" in answer:
            raise CcpinError(f"the browser refuses {name}: {answer['error'].get('message')}")
        return dict(answer["result"])

    async def _open(self, url: str, width: int, height: int) -> None:
        try:
            import choreographer
            from choreographer.browsers.chromium import ChromeNotFoundError
        except ImportError:
            message = "films are drawn by a headless Chromium, which choreographer drives: pip install 'ccpin[video]'"
            raise CcpinError(message) from None
        try:
            self._browser = await choreographer.Browser(headless=True)
        except ChromeNotFoundError:
            message = "films are drawn by a headless Chromium (or Chrome, Edge, Brave), and none is installed here"
            raise CcpinError(message) from None
        self._tab = await self._browser.create_tab("about:blank")
        self._tab.subscribe("Runtime.consoleAPICalled", self._heard)
        self._tab.subscribe("Runtime.exceptionThrown", self._heard)
        self._tab.subscribe("Log.entryAdded", self._heard)
        for name in ("Runtime.enable", "Log.enable", "Page.enable"):
            await self._send(name)
        window = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        await self._send("Emulation.setDeviceMetricsOverride", window)
        await self._send("Page.navigate", {"url": url})
        await self._loaded(url)

    async def _loaded(self, url: str) -> None:
        asked = {"expression": "document.URL !== 'about:blank' && document.readyState", "returnByValue": True}
        while (await self._send("Runtime.evaluate", asked))["result"].get("value") != "complete":
            await asyncio.sleep(0.02)

    async def _heard(self, message: dict[str, Any]) -> None:
        said = message["params"]
        if message["method"] == "Runtime.exceptionThrown":
            self.problems.append(_thrown(said["exceptionDetails"]))
        elif message["method"] == "Log.entryAdded":
            entry = said["entry"]
            if entry["level"] in ("error", "warning") and DRIVER not in entry["text"]:
                self.problems.append(entry["text"])
        elif said.get("type") in ("error", "warning", "assert"):
            self.problems.append(" ".join(str(part.get("value", part.get("description"))) for part in said["args"]))


def _thrown(details: dict[str, Any]) -> str:
    return str(details.get("exception", {}).get("description", details.get("text")))
