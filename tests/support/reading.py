"""Descriptions of what a text states, without a file."""

from pathlib import Path

from ccpin.description.elements.xml import parse_xml
from ccpin.description.mjcf.reader import mjcf_description
from ccpin.description.model import MechanismDescription
from ccpin.description.sdf.reader import sdf_description
from ccpin.description.urdf.reader import urdf_description


def read_urdf(text: bytes, source: str | None) -> MechanismDescription:
    """A URDF; `source` is a path for messages and for finding meshes."""
    return urdf_description(parse_xml(text, source))


def read_mjcf(text: bytes, source: str | None, include_root: str | Path | None = None) -> MechanismDescription:
    """An MJCF file."""
    return mjcf_description(parse_xml(text, source), include_root=include_root)


def read_sdf(text: bytes, source: str | None, model: str | None = None) -> MechanismDescription:
    """One model of an SDFormat file."""
    return sdf_description(parse_xml(text, source), model=model)
