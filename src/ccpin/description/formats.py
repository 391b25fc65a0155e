"""The registry of formats: how a file of each is recognised, who reads it and who writes it.

A reader or writer is loaded with the first file of its format. To add one: a module that returns (or takes) a
`MechanismDescription`, and an entry of `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ccpin.description.elements.meshes import with_meshes_beside
from ccpin.description.finding import read_file
from ccpin.description.model import MechanismDescription
from ccpin.errors import AmbiguousFormatError, CcpinError, InvalidInputError

if TYPE_CHECKING:
    from ccpin.description.elements.xml import XmlElement

_XML_BEGINS = (b"<", b"\xef\xbb\xbf<", b"\xff\xfe", b"\xfe\xff")


@dataclass(frozen=True)
class Source:
    """A file to be read, and what its reader is told (`read_description` says what of).

    Attributes:
        file: Its path.
        content: What is in it.
        model, include_root, xacro, xacro_arguments: As for `read_description`.
    """

    file: Path
    content: bytes
    model: str | None = None
    include_root: str | Path | None = None
    xacro: bool = False
    xacro_arguments: Mapping[str, str] | None = None

    @property
    def is_xml(self) -> bool:
        """Whether the content begins as XML does."""
        return self.content.lstrip().startswith(_XML_BEGINS)

    @cached_property
    def root(self) -> XmlElement:
        """The XML's root element, parsed once.

        Raises:
            InvalidXmlError: It is malformed, or refused for safety.
        """
        from ccpin.description.elements.xml import parse_xml

        return parse_xml(self.content, str(self.file))


class Format(NamedTuple):
    """What there is to know of a format.

    Attributes:
        title: What its authors call it.
        suffixes: What the names of files that are written in it end in, in lower case.
        read: Its reader.
        write: Its writer; it returns what the format has no place for, in sentences.
        root: The tag of its XML's root element; ``None``: it is not XML.
        key: What a file that is not XML must hold to be of it.
        expands: Whether its files may hold xacro.
    """

    title: str
    suffixes: tuple[str, ...]
    read: Callable[[Source], MechanismDescription]
    write: Callable[[MechanismDescription, str | Path], tuple[str, ...]]
    root: str | None = None
    key: str = ""
    expands: bool = False

    def recognises(self, source: Source) -> bool:
        """Whether a file's content shows the format."""
        from ccpin.description.elements.xml import tag

        if self.root is None:
            return not source.is_xml and self.key.encode() in source.content
        return source.is_xml and tag(source.root) == self.root


def _read_urdf(source: Source) -> MechanismDescription:
    from ccpin.description.urdf.reader import urdf_description
    from ccpin.description.urdf.xacro import without_xacro

    root, said = without_xacro(source.root, source.file, source.xacro, source.xacro_arguments)
    description = urdf_description(root)
    return replace(description, notes=(*said, *description.notes))


def _write_urdf(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    from ccpin.description.urdf.writer import write_urdf

    return write_urdf(description, path)


def _write_drake(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    from ccpin.description.urdf.writer import write_urdf

    return write_urdf(description, path, "drake")


def _write_isaac(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    from ccpin.description.urdf.writer import write_urdf

    return write_urdf(description, path, "isaac")


def _read_sdf(source: Source) -> MechanismDescription:
    from ccpin.description.sdf.reader import sdf_description

    return sdf_description(source.root, model=source.model, include_root=source.include_root)


def _write_sdf(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    from ccpin.description.sdf.writer import write_sdf

    return write_sdf(description, path)


def _read_mjcf(source: Source) -> MechanismDescription:
    from ccpin.description.mjcf.reader import mjcf_description

    return mjcf_description(source.root, include_root=source.include_root)


def _write_mjcf(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    from ccpin.description.mjcf.writer import write_mjcf

    return write_mjcf(description, path)


def _read_toolbox(source: Source) -> MechanismDescription:
    from ccpin.description.toolbox.reader import toolbox_description

    return toolbox_description(source.content, source.file)


def _write_toolbox(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    from ccpin.description.toolbox.writer import write_toolbox

    return write_toolbox(description, path)


FORMATS: dict[str, Format] = {
    "urdf": Format("URDF", (".urdf",), _read_urdf, _write_urdf, root="robot", expands=True),
    "sdf": Format("SDFormat", (".sdf",), _read_sdf, _write_sdf, root="sdf"),
    "mjcf": Format("MJCF", (".xml", ".mjcf"), _read_mjcf, _write_mjcf, root="mujoco"),
    "toolbox": Format("toolbox", (".yaml", ".yml"), _read_toolbox, _write_toolbox, key="closed_loop"),
    "drake": Format("URDF with Drake's constraints", (".urdf",), _read_urdf, _write_drake, root="robot", expands=True),
    "isaac": Format("URDF with Isaac Sim's loops", (".urdf",), _read_urdf, _write_isaac, root="robot", expands=True),
}
"""Every format by name; a new entry is read, written, and offered by the command line.

Of those with one suffix the first is written where only a path is given. A file shows that it is a URDF, never whose.
"""


def format_of(path: str | Path) -> str | None:
    """The format that a path's suffix stands for, if there is one."""
    suffix = Path(path).suffix.lower()
    return next((name for name, known in FORMATS.items() if suffix in known.suffixes), None)


def read_description(
    path: str | Path,
    format: str | None = None,
    *,
    model: str | None = None,
    include_root: str | Path | None = None,
    xacro: bool = False,
    xacro_arguments: Mapping[str, str] | None = None,
) -> MechanismDescription:
    """Read a file in the format its content shows, or in the one named.

    Args:
        path: File or installed model's name; a folder stands for the robot.yaml, robot.urdf, robot.xml or model.sdf
            in it.
        format: ``"urdf"``, ``"sdf"``, ``"mjcf"`` or ``"toolbox"`` (toolbox-parallel-robots: YAML beside a URDF).
        model: Which model of an SDFormat file to read, where it holds several.
        include_root: The folder an SDFormat or MJCF file may include others from; default its own.
        xacro: Expand xacro elements and expressions also where the file's name does not end in ``.xacro``. A xacro
            file is a program, so no other is expanded unasked (`ccpin.description.urdf.xacro`).
        xacro_arguments: Values of a xacro file's arguments.

    Raises:
        DescriptionNotFoundError, AmbiguousFormatError, InvalidXmlError, DescriptionError: See `ccpin.errors`.
    """
    if format is not None and (not isinstance(format, str) or format not in FORMATS):
        raise AmbiguousFormatError(f"format {format!r:.80} is not one of {', '.join(FORMATS)}", source=str(path))
    source = Source(*read_file(path), model, include_root, xacro, xacro_arguments)
    return (_recognised(source) if format is None else _fitting(FORMATS[format], source)).read(source)


def _recognised(source: Source) -> Format:
    """The format that the content shows.

    Raises:
        AmbiguousFormatError: None.
    """
    found = next((known for known in FORMATS.values() if known.recognises(source)), None)
    if found is not None:
        return _fitting(found, source)
    of_root = dict[str, Format]()  # the first of each
    for each in FORMATS.values():
        if each.root is not None:
            of_root.setdefault(each.root, each)
    if source.is_xml:
        from ccpin.description.elements.xml import tag

        _refuse_xacro(source)
        known = ", ".join(f"<{known.root}> ({known.title})" for known in of_root.values())
        message = f"the root element <{tag(source.root)}> is none of {known}"
    else:
        keys = " or ".join(f"'{known.key}'" for known in FORMATS.values() if known.root is None)
        titles = ", ".join(known.title for known in of_root.values())
        message = f"neither XML ({titles}) nor a file with a {keys} key"
    raise AmbiguousFormatError(message, source=str(source.file))


def _fitting(known: Format, source: Source) -> Format:
    """The format, if its reader may have the file."""
    if known.root is not None and not known.expands:
        _refuse_xacro(source)
    return known


def _refuse_xacro(source: Source) -> None:
    from ccpin.description.elements.xml import fail
    from ccpin.description.urdf.xacro import is_xacro

    if is_xacro(source.root):
        message = "the file holds xacro elements; only URDFs are expanded here, so give the expanded file"
        raise fail(source.root, message)


def format_written(path: str | Path, format: str | None = None) -> str:
    """The format that a file is to be written in: the one named, or what its suffix stands for.

    Raises:
        InvalidInputError: There is none, or the path is no path.
    """
    if not isinstance(path, str | Path):
        raise InvalidInputError(f"a file to write must be a path, not {type(path).__name__}")
    wanted = format_of(path) if format is None else format
    if not isinstance(wanted, str) or wanted not in FORMATS:
        told = f"format {format!r:.80}" if format is not None else f"the suffix of '{path}'"
        raise InvalidInputError(
            f"{told} names none of {', '.join(FORMATS)}; say which: format=, or --to on the command line"
        )
    return wanted


LOOPS = ("as_stated", "tight")
"""How softly MuJoCo is told to hold loops."""
MESHES = ("kept", "copied")
"""Where the files that shapes are read from are to lie."""


def write_description(
    description: MechanismDescription,
    path: str | Path,
    format: str | None = None,
    *,
    loops: str = "as_stated",
    meshes: str = "kept",
) -> tuple[str, ...]:
    """Write a description as a file that `ccpin.load` and the format's own tools read.

    Args:
        description: What to write.
        path: The file; its suffix tells the format where `format` does not (.urdf, .sdf, .xml, .yaml).
        format: ``"urdf"`` (with URDF+ loops), ``"sdf"``, ``"mjcf"``, ``"toolbox"`` (robot.yaml with its robot.urdf),
            ``"drake"`` or ``"isaac"`` (URDFs whose loops are Drake's constraints, or Isaac Sim's).
        loops: Of MJCF, how softly MuJoCo holds the loops: ``"as_stated"`` by the file read (MuJoCo's own numbers where
            it is silent), or ``"tight"``, as tightly as a step allows (`ccpin.description.mjcf.tightening`).
        meshes: Whether mesh files stay where they are, named by their whole path (``"kept"``), or are copied into a
            folder ``meshes`` beside the file and named from there (``"copied"``).

    Returns:
        What the description states and the format has no place for, in sentences.

    Raises:
        InvalidInputError: The format is none of these, ``loops="tight"`` where it is not MJCF, or a file cannot be
            written.
        DescriptionError: The format has no words for something, by name.
        CcpinError: A library that writes the format does not load.
    """
    for word, value, known in (("loops", loops, LOOPS), ("meshes", meshes, MESHES)):
        if value not in known:
            raise InvalidInputError(f"{word}={value!r:.80} is none of {', '.join(known)}")
    wanted = format_written(path, format)
    if loops == "tight":
        if wanted != "mjcf":
            raise InvalidInputError(f"loops='tight' is about MuJoCo's soft loops: {wanted} states none")
        from ccpin.description.mjcf.tightening import tightened

        description = tightened(description)
    if meshes == "copied":
        description = with_meshes_beside(description, Path(path))
    try:
        return FORMATS[wanted].write(description, path)
    except ImportError as error:
        raise CcpinError(f"what writes {wanted} files does not load ({error}): install that package anew") from error
