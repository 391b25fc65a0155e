"""MeshCat without a server process: its commands recorded, and written into one self-contained web page."""

from __future__ import annotations

import base64
import html
import json
import re
from pathlib import Path
from typing import Any, NamedTuple


class CommandRecorder:
    """Stands in for MeshCat's window: keeps the packed commands that produce the scene, in order.

    A command that overrides an earlier one (same type, path and property) takes its place, so that moving a link
    a thousand times costs no memory.
    """

    def __init__(self) -> None:
        self._commands: dict[tuple[str, str, str], bytes] = {}

    @property
    def commands(self) -> tuple[bytes, ...]:
        """The msgpack-encoded commands."""
        return tuple(self._commands.values())

    def send(self, command: Any) -> None:
        """Keep one MeshCat command (anything whose ``lower()`` gives the message)."""
        import umsgpack  # type: ignore[import-untyped]

        message = command.lower()
        key = (message["type"], message["path"], message.get("property", ""))
        packed = self._commands[key] = umsgpack.packb(message)
        self._forward(packed)

    def _forward(self, packed: bytes) -> None:
        """What else to do with a command: nothing, unless browsers are watching."""


class SceneCommand(dict[str, Any]):
    """A MeshCat message given as it goes over the wire."""

    def lower(self) -> dict[str, Any]:
        """The message itself."""
        return self


ASSETS = Path(__file__).parent / "assets"
SCRIPTS = ("stage.js", "views.js", "overlays.js", "player.js")
CONNECT = "viewer.connect(`ws://${location.host}${location.pathname}scene`);"
REPLAY = """for (const command of commands)
  viewer.handle_command_bytearray(Uint8Array.from(atob(command), c => c.charCodeAt(0)));"""


class PageParts(NamedTuple):
    """What a page has besides the scene: its markup, its style, and what its script does once the scene runs."""

    markup: str = ""
    style: str = ""
    script: str = ""


ALONE = PageParts()


def render_page(title: str, commands: tuple[bytes, ...], live: bool = False, beside: PageParts = ALONE) -> str:
    """The web page: MeshCat's own viewer, ccpin's stage and player, the commands; no outside references.

    A live page carries no commands: it receives them over a web socket from the server it came from.
    """
    import meshcat

    viewer = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    encoded = json.dumps([base64.b64encode(command).decode("ascii") for command in commands])
    parts = {
        "@NOTICES@": _notices(viewer),
        "@MESHCAT@": viewer.read_text(encoding="utf-8"),
        "@STYLE@": _asset("page.css") + beside.style,
        "@SCRIPT@": "\n".join(_asset(name) for name in SCRIPTS),
        "@TITLE@": html.escape(title),
        "@BESIDE@": beside.markup,
        "@AFTER@": beside.script,
        "@START@": CONNECT if live else f"const commands = {encoded};\n{REPLAY}",
    }
    return re.sub("|".join(parts), lambda found: parts[found.group()], _asset("page.html"))


def _notices(viewer: Path) -> str:
    """The licences of MeshCat and of what its viewer is built from, which every copy is to carry."""
    parts = json.loads(Path(f"{viewer}.THIRD_PARTY_LICENSES.json").read_text(encoding="utf-8"))
    texts = [f"MeshCat\n{viewer.parents[1].joinpath('LICENSE').read_text(encoding='utf-8')}"]
    texts += [f"{part['name']}, {part['author']}, {part['license']}\n{part['licenseText'] or ''}" for part in parts]
    return "\n\n".join(text.strip() for text in texts).replace("--", "––")


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")
