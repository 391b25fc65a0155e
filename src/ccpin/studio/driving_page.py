"""The studio's web page: a scene, and beside it dials, map, experiment and plots; live, or as one offline file."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ccpin.visualization.scene_page import PageParts, render_page

ASSETS = Path(__file__).parent / "assets"
SCRIPTS = ("link.js", "drive.js", "chart.js", "plots.js", "handle.js", "experiment.js", "start.js")


def studio_page(
    title: str, commands: tuple[bytes, ...], told: dict[str, Any], replay: Sequence[dict[str, Any]] | None = None
) -> str:
    """The page's text.

    Args:
        title: Its heading.
        commands: MeshCat's commands of the scene.
        told: What the page knows from the start (`Subject.told`).
        replay: Messages it hears when it is opened, in place of a server; ``None``: it asks the server it is from.
    """
    script = "\n".join(_asset(name) for name in SCRIPTS)
    data = f"const facts = {_json(told)}, replay = {_json(replay)};"
    beside = PageParts(_asset("studio.html"), "\n" + _asset("studio.css"), f"{{\n{data}\n{script}\n}}")
    return render_page(title, commands, beside=beside)


def _json(value: Any) -> str:
    """JSON that may stand in a script element."""
    return json.dumps(value).replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")
