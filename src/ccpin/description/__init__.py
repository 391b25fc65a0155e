"""What a file says of a mechanism: one reader and one writer a format, all of the same plain `MechanismDescription`."""

from ccpin.description.changes.combining import Part, combine
from ccpin.description.changes.scaling import scaled
from ccpin.description.closure_kinds import CLOSURE_KINDS
from ccpin.description.formats import FORMATS, read_description
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.description.model import Coupling, CouplingTerm, Inertia, Joint, Link, Motor, Shape, Visual

__all__ = [
    "CLOSURE_KINDS",
    "FORMATS",
    "JOINT_KINDS",
    "Coupling",
    "CouplingTerm",
    "Inertia",
    "Joint",
    "Link",
    "Motor",
    "Part",
    "Shape",
    "Visual",
    "combine",
    "read_description",
    "scaled",
]
__dir__ = __all__.copy
