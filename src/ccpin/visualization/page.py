"""MeshCat without a server process: its commands recorded, and written into one self-contained web page."""

from __future__ import annotations

import base64
import html
import json
import re
from pathlib import Path
from typing import Any, NamedTuple


class Recorder:
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


class Command(dict[str, Any]):
    """A MeshCat message given as it goes over the wire."""

    def lower(self) -> dict[str, Any]:
        """The message itself."""
        return self


class Clock(NamedTuple):
    """What the page's time display needs: t = start + speed × animation time."""

    start: float = 0.0
    speed: float = 1.0


def render_page(title: str, commands: tuple[bytes, ...], clock: Clock, live: bool = False) -> str:
    """The web page: MeshCat's own viewer inlined, the commands, a title and a playback bar; no outside references.

    A live page carries no commands: it receives them over a web socket from the server it came from.
    """
    import meshcat

    script = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
    encoded = json.dumps([base64.b64encode(command).decode("ascii") for command in commands])
    parts = {
        "@MESHCAT@": script.read_text(encoding="utf-8"),
        "@TITLE@": html.escape(title),
        "@CLOCK@": json.dumps({"start": clock.start, "speed": clock.speed}),
        "@START@": CONNECT if live else f"const commands = {encoded};\n{REPLAY}",
    }
    return re.sub("|".join(parts), lambda found: parts[found.group()], TEMPLATE)


CONNECT = "viewer.connect(`ws://${location.host}/scene`);"
REPLAY = """for (const command of commands)
  viewer.handle_command_bytearray(Uint8Array.from(atob(command), c => c.charCodeAt(0)));"""

TEMPLATE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>@TITLE@</title>
<style>
  html, body { margin: 0; height: 100%; overflow: hidden; font: 14px/1.4 system-ui, sans-serif; color: #28303a; }
  #pane { width: 100vw; height: 100vh; overflow: hidden; }
  #title { position: absolute; left: 18px; top: 14px; font-size: 17px; font-weight: 600; pointer-events: none; }
  #bar { position: absolute; left: 50%; bottom: 16px; transform: translateX(-50%); width: min(560px, 86vw);
         display: none; align-items: center; gap: 12px; padding: 6px 14px; border-radius: 10px;
         background: rgba(255, 255, 255, .82); box-shadow: 0 1px 6px rgba(30, 40, 55, .18); }
  #bar input { flex: 1; accent-color: #2970bd; min-width: 0; }
  #bar button { border: 0; padding: 0; width: 26px; background: none; color: inherit; cursor: pointer; }
  #time { min-width: 66px; text-align: right; font-variant-numeric: tabular-nums; }
  .dg.main > .close-button { position: absolute !important; right: 0; width: 108px !important;
         border-radius: 0 0 0 8px; background: rgba(255, 255, 255, .82) !important; color: #28303a; }
</style>
</head>
<body>
<div><div id="pane"></div></div>
<div id="title">@TITLE@</div>
<div id="bar"><button id="play" aria-label="Play or pause"></button>
<input id="scrub" type="range" min="0" max="1" step="any" value="0" aria-label="Time"><span id="time"></span></div>
<script>@MESHCAT@</script>
<script>
const viewer = new MeshCat.Viewer(document.getElementById("pane"));
const clock = @CLOCK@;
@START@
const [bar, play, scrub, time] = ["bar", "play", "scrub", "time"].map(id => document.getElementById(id));
let framed = "";
function frame() {                       // zoom so that what was framed fits a window of any shape
  const camera = viewer.camera, fit = camera.userData.fit;
  const state = JSON.stringify([fit, innerWidth, innerHeight]);
  if (!fit || state === framed) return;
  framed = state;
  const aspect = innerWidth / innerHeight;
  camera.zoom = fit[2] * Math.tan(camera.fov * Math.PI / 360) / Math.max(fit[1], fit[0] / aspect);
  viewer.set_dirty();
}
function step() {
  requestAnimationFrame(step);
  frame();
  const animator = viewer.animator;
  bar.style.display = animator.duration > 0 ? "flex" : "none";
  if (!(animator.duration > 0)) return;
  const now = Math.max(...animator.actions.map(action => action.time));
  play.textContent = animator.playing ? "\\u275A\\u275A" : "\\u25B6";
  scrub.max = animator.duration;
  scrub.value = now;
  time.textContent = (clock.start + clock.speed * now).toFixed(2) + " s";
}
play.onclick = () => viewer.animator.playing ? viewer.animator.pause() : viewer.animator.play();
scrub.oninput = () => { const at = Number(scrub.value); viewer.animator.pause(); viewer.animator.seek(at); };
step();
</script>
</body>
</html>
"""
