"""Which elements and attributes MJCF has, as far as ccpin reads them.

A misspelt attribute would otherwise be silently ignored, which for a mechanism means a silently wrong model.
"""

from __future__ import annotations

WORLD = "world"
ORIENTATIONS = frozenset({"quat", "axisangle", "xyaxes", "zaxis", "euler"})

_FRAME = "pos quat axisangle xyaxes zaxis euler"
_EQUALITY = "name class active solref solimp"
_JOINT = (
    "name class type group pos axis springdamper limited actuatorfrclimited solreflimit solimplimit "
    "solreffriction solimpfriction stiffness range actuatorfrcrange actuatorgravcomp margin ref springref "
    "springyield armature damping frictionloss user"
)
_COMPILER = (
    "alignfree angle assetdir autolimits balanceinertia boundinertia boundmass conflict convexhull coordinate "
    "discardvisual eulerseq exactmeshinertia fitaabb fusestatic inertiafromgeom inertiagrouprange meshdir "
    "passthrough savecanonical savecompiled saveinertial settotalmass strippath texturedir usethread"
)
_GEOM = (
    "name class type contype conaffinity condim group priority size material friction mass density "
    "shellinertia solmix solref solimp margin gap fromto hfield mesh fitscale rgba fluidshape fluidcoef "
    "adhesion castshadow surfacevel user"
)
_MESH = (
    "name class content_type file vertex normal texcoord face refpos refquat scale smoothnormal maxhullvert "
    "inertia builtin params material"
)

ATTRIBUTES: dict[str, frozenset[str]] = {
    tag: frozenset(names.split())
    for tag, names in {
        "compiler": _COMPILER,
        "body": f"name childclass mocap gravcomp user simple sleep fuse {_FRAME}",
        "worldbody": "name",
        "frame": f"name childclass {_FRAME}",
        "inertial": f"mass diaginertia fullinertia {_FRAME}",
        "joint": _JOINT,
        "equality/joint": f"{_EQUALITY} joint1 joint2 polycoef",
        "freejoint": "name group align",
        "geom": f"{_GEOM} {_FRAME}",
        "site": f"name class type group material size fromto mesh rgba user {_FRAME}",
        "connect": f"{_EQUALITY} body1 body2 anchor site1 site2",
        "weld": f"{_EQUALITY} body1 body2 anchor relpose torquescale site1 site2",
        "equality": "active solref solimp",
        "mesh": _MESH,
        "include": "file",
    }.items()
}

_SECTIONS = (
    "compiler option size statistic visual default extension custom asset worldbody deformable contact tendon "
    "equality actuator sensor keyframe"
)
SECTIONS = frozenset(_SECTIONS.split())
BODY_IGNORED = frozenset({"camera", "light", "plugin"})
BODY_UNSUPPORTED = frozenset({"attach", "composite", "flexcomp", "replicate"})
