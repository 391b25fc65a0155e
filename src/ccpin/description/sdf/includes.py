"""<include>: finding the model a file takes from another, within the folder that is allowed."""

from __future__ import annotations

from pathlib import Path

from ccpin.description.elements.xml import XmlElement, fail, parse_xml, source_of, tag
from ccpin.description.sdf.values import first, required, text
from ccpin.errors import DescriptionError

MOST_FILES = 500  # of one model: bounds time, where files include each other over and over
DEEPEST = 16  # includes inside each other: more are taken for a circle
_SCHEMES = ("model://", "package://", "file://")


class Including:
    """Finds included models next to the file that asks for them, never outside one folder.

    Args:
        root: The folder nothing may be taken from outside of.
    """

    def __init__(self, root: Path) -> None:
        self._root = root.resolve()
        self._count = 0
        self._depth = 0
        self._parsed: dict[Path, XmlElement] = {}

    def model(self, include: XmlElement) -> XmlElement:
        """The <model> an <include> names; `leave` ends what is inside it.

        Raises:
            DescriptionError: It is absent, outside the folder, remote, or holds no single model.
            InvalidXmlError: The included file is not well-formed.
        """
        path = self._locate(include, required(include, "uri"))
        self._count += 1
        self._depth += 1
        if self._count > MOST_FILES or self._depth > DEEPEST:
            raise fail(include, f"more than {MOST_FILES} includes, or {DEEPEST} inside each other: a circle, perhaps")
        if path not in self._parsed:
            try:
                content = path.read_bytes()
            except OSError as error:
                raise fail(include, f"the file '{path.name}' cannot be read: {error.strerror}") from None
            self._parsed[path] = parse_xml(content, str(path))
        document = self._parsed[path]
        found = document if tag(document) == "model" else first(document, "model")
        if found is None:
            raise fail(include, f"the file '{path.name}' holds no <model>")
        return found

    def leave(self) -> None:
        """The last included model is read."""
        self._depth -= 1

    def _locate(self, include: XmlElement, uri: str) -> Path:
        source = source_of(include)
        if source is None or not Path(source).is_file():
            raise fail(include, f"'{uri}' cannot be found, because this model was not read from a file")
        name = next((uri[len(scheme) :] for scheme in _SCHEMES if uri.startswith(scheme)), uri)
        if "://" in name or "\0" in name or not name.strip("/. "):
            raise fail(include, f"'{uri[:120]}' is no file beside this one (nothing is fetched from elsewhere)")
        folder, allowed = Path(source).resolve().parent, self._root
        try:
            above = (path for path in folder.parents if path.is_relative_to(allowed))
            candidates = [(base / name).resolve() for base in (folder, *above)]
            inside = [path for path in candidates if path.is_relative_to(allowed)]
            found = next((path for path in map(_model_file, inside) if path is not None), None)
        except (OSError, ValueError):
            candidates, inside, found = [], [], None
        if found is not None:
            return found
        if not inside:
            raise fail(
                include, f"'{uri[:120]}' lies outside {allowed.name}/, which is refused (include_root allows it)"
            )
        raise fail(
            include, f"there is no '{uri[:120]}' in {allowed.name}/ (include_root names another folder to look in)"
        )


def _model_file(path: Path) -> Path | None:
    """The file itself, or the one a model's folder holds."""
    if path.is_file():
        return path
    return model_in(path) if path.is_dir() else None


def model_in(folder: Path) -> Path | None:
    """The SDFormat file of a model's folder: model.sdf, or the one its model.config names."""
    if (folder / "model.sdf").is_file():
        return folder / "model.sdf"
    config = folder / "model.config"
    if not config.is_file():
        return None
    try:
        named = text(parse_xml(config.read_bytes(), str(config)), "sdf")
    except (OSError, DescriptionError):
        return None
    found = (folder / (named or "")).resolve()
    return found if named and found.is_file() and found.is_relative_to(folder.resolve()) else None
