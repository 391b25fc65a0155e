"""``<include>``: other MJCF files inserted where they are named, from the model's own folder only."""

from __future__ import annotations

from pathlib import Path

from ccpin.description.mjcf_element import Element, XmlElement
from ccpin.description.xml import parse_xml


def expand_includes(root: XmlElement, source: str | None) -> None:
    """Replace every ``<include>`` below `root` by the content of the file it names.

    File names are relative to the folder of `source`, whatever file they stand in. Each file may come once.

    Raises:
        DescriptionError: The file is absent, outside the folder of `source`, included twice, or empty.
        InvalidXmlError: The included file is not well-formed.
    """
    seen = {Path(source).resolve()} if source else set()
    while (include := next(root.iter("include"), None)) is not None:
        said = Element.of(include, source)
        path = _locate(said, source)
        if path in seen:
            raise said.fail(f"the file '{path.name}' is included twice")
        seen.add(path)
        content = list(parse_xml(path.read_bytes(), str(path)).iterchildren("*"))
        if not content:
            raise said.fail(f"the file '{path.name}' holds nothing to include")
        parent, index = include.getparent(), include.getparent().index(include)
        parent.remove(include)
        for offset, child in enumerate(content):
            parent.insert(index + offset, child)


def _locate(said: Element, source: str | None) -> Path:
    name = said.required("file")
    if source is None or not Path(source).is_file():
        raise said.fail(f"the file '{name}' cannot be found, because this model was not read from a file")
    folder = Path(source).resolve().parent
    path = (folder / name).resolve()
    if not path.is_relative_to(folder):
        raise said.fail(f"the file '{name}' lies outside the model's folder, which is refused")
    if not path.is_file():
        raise said.fail(f"there is no file '{name}' in the model's folder")
    return path
