"""The studio: a mechanism in the browser, moved by hand through σ, with the map of Ω and experiments beside it."""

from __future__ import annotations

from pathlib import Path

from ccpin.arrays import whole
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.studio.cache import Cache
from ccpin.studio.server import Studio
from ccpin.studio.subject import Subject

__all__ = ["studio"]
__dir__ = __all__.copy

LAST_PORT = 65535  # that TCP has


def studio(
    mechanism: Mechanism | HasMechanism,
    *,
    port: int = 0,
    open_browser: bool = True,
    title: str | None = None,
    cache: str | Path | None = None,
) -> Studio:
    """Open a studio on the loopback interface; it serves from a thread until it is closed.

    Args:
        mechanism: From `ccpin.load`, or a model of it.
        port: Where; 0 for any that is free.
        open_browser: Whether to open it in the machine's browser.
        title: Heading; default the name of the mechanism's file.
        cache: Folder in which atlases are kept by the mechanism's fingerprint; default ``$CCPIN_CACHE``, else ``ccpin``
            in the user's cache folder.

    Raises:
        InvalidInputError: It is no mechanism, or no port.
        UnsupportedMechanismError: The mechanism has mobility 0.
        CcpinError: The port cannot be opened.
    """
    if whole(port, "port", 0) > LAST_PORT:
        raise InvalidInputError(f"port = {port} must be a whole number up to {LAST_PORT}")
    kept = Cache(None if cache is None else Path(cache))
    return Studio(Subject(mechanism_of(mechanism), title, kept), port, open_browser)
