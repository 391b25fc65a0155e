"""Which elements and attributes MJCF has, as far as ccpin reads them.

A misspelt attribute would otherwise be silently ignored, which for a mechanism means a silently wrong model.
"""

from __future__ import annotations

WORLD = "world"
KINDS = {"free": "floating", "ball": "spherical", "slide": "prismatic", "hinge": "revolute"}
"""What each type of joint is in a description."""
FORCES = {"armature": "armature", "damping": "damping", "frictionloss": "friction", "stiffness": "stiffness"}
"""What each attribute of a joint's own forces is there."""
SOFT = ("solref", "solimp")
"""How soft an equality is."""
SOFT_JOINT = ("solreflimit", "solimplimit", "solreffriction", "solimpfriction", "margin")
"""How soft a joint's limits and friction are, and how soon its limits are felt."""
DISABLED = ("gravity", "equality", "spring", "damper", "passive", "frictionloss", "actuation")
"""Flags that switch parts of the mechanism off, which the reader does."""
ORIENTATIONS = frozenset({"quat", "axisangle", "xyaxes", "zaxis", "euler"})

_FRAME = "pos quat axisangle xyaxes zaxis euler"
_EQUALITY = "name class active solref solimp"
_GEOM = (
    "name class type contype conaffinity condim group priority size material friction mass density "
    "shellinertia solmix solref solimp margin gap fromto hfield mesh fitscale rgba fluidshape fluidcoef "
    "adhesion castshadow surfacevel user"
)

_ACTUATOR = "name class group nsample interp delay ctrllimited forcelimited ctrlrange forcerange user"
_DRIVEN = (
    f"{_ACTUATOR} lengthrange gear damping armature cranklength joint jointinparent tendon cranksite slidersite site "
    "refsite"
)

ATTRIBUTES: dict[str, frozenset[str]] = {
    tag: frozenset(names.split())
    for tag, names in {
        "compiler": (
            "alignfree angle assetdir autolimits balanceinertia boundinertia boundmass conflict convexhull coordinate "
            "discardvisual eulerseq exactmeshinertia fitaabb fusestatic inertiafromgeom inertiagrouprange meshdir "
            "passthrough savecanonical savecompiled saveinertial settotalmass strippath texturedir usethread"
        ),
        "body": f"name childclass mocap gravcomp user simple sleep fuse {_FRAME}",
        "mujoco": "model",
        "mujoco/worldbody": "",
        "mujoco/asset": "",
        "mujoco/actuator": "",
        "mujoco/equality": "",
        "option": (
            "timestep apirate impratio tolerance ls_tolerance noslip_tolerance mpr_tolerance ccd_tolerance "
            "sleep_tolerance gravity wind magnetic density viscosity o_margin o_solref o_solimp o_friction integrator "
            "collision cone jacobian solver iterations ls_iterations noslip_iterations mpr_iterations ccd_iterations "
            "sdf_iterations sdf_initpoints actuatorgroupdisable"
        ),
        "flag": (
            "constraint equality frictionloss limit contact passive spring damper gravity clampctrl warmstart "
            "filterparent actuation refsafe sensor midphase eulerdamp autoreset nativeccd island override energy "
            "fwdinv invdiscrete multiccd sleep diagexact ipc speculative"
        ),
        "default": "class",
        "material": (
            "name class texture texrepeat texuniform emission specular shininess reflectance metallic roughness rgba"
        ),
        "frame": f"name childclass {_FRAME}",
        "replicate": "childclass count offset sep euler",
        "inertial": f"mass diaginertia fullinertia {_FRAME}",
        "joint": (
            "name class type group pos axis springdamper limited actuatorfrclimited solreflimit solimplimit "
            "solreffriction solimpfriction stiffness range actuatorfrcrange actuatorgravcomp margin ref springref "
            "springyield armature damping frictionloss user"
        ),
        "equality/joint": f"{_EQUALITY} joint1 joint2 polycoef",
        "equality/tendon": f"{_EQUALITY} tendon1 tendon2 polycoef",
        "fixed/joint": "joint coef",
        "spatial/site": "site",
        "freejoint": "name group align",
        "geom": f"{_GEOM} {_FRAME}",
        "site": f"name class type group material size fromto mesh rgba user {_FRAME}",
        "connect": f"{_EQUALITY} body1 body2 anchor site1 site2",
        "weld": f"{_EQUALITY} body1 body2 anchor relpose torquescale site1 site2",
        "equality": "active solref solimp",
        "mesh": (
            "name class content_type file vertex normal texcoord face refpos refquat scale smoothnormal maxhullvert "
            "inertia builtin params material"
        ),
        "include": "file",
        "adhesion": f"{_ACTUATOR} body gain",
        "cylinder": f"{_DRIVEN} actearly timeconst area diameter bias",
        "damper": f"{_DRIVEN} kv",
        "dcmotor": (
            f"{_DRIVEN} actearly actlimited actrange motorconst resistance nominal saturation inductance cogging "
            "controller thermal lugre input"
        ),
        "general": (
            f"{_DRIVEN} body actearly actlimited actrange dyntype gaintype biastype dynprm gainprm biasprm actdim "
            "input ffrange velrange inheritrange"
        ),
        "intvelocity": f"{_DRIVEN} actearly actlimited actrange kp kv dampratio inheritrange",
        "motor": _DRIVEN,
        "muscle": (
            f"{_DRIVEN} actearly actlimited actrange timeconst tausmooth range force scale lmin lmax vmax fpmax fvmax"
        ),
        "orientation": f"{_ACTUATOR} kp kv dampratio input inheritrange joint site refsite",
        "pid": f"{_DRIVEN} input kp ki kv dampratio imax slewmax posrange velrange ffrange inheritrange",
        "actuator/plugin": f"{_DRIVEN} plugin instance actearly actlimited actrange actdim dyntype dynprm",
        "position": f"{_DRIVEN} actearly actlimited actrange kp kv dampratio timeconst inheritrange",
        "velocity": f"{_DRIVEN} kv",
    }.items()
}

_NUMBERS = (
    "pos size fromto mass density group contype conaffinity condim priority friction margin gap solmix solref solimp "
    "solreflimit solimplimit solreffriction solimpfriction range ref springref stiffness damping frictionloss "
    "armature axis gear kp kv gainprm biasprm ctrlrange forcerange "
    "gravcomp anchor relpose torquescale polycoef diaginertia fullinertia rgba area "
    "diameter bias timeconst tausmooth inheritrange inductance resistance thermal lugre springdamper "
    "dampratio count offset"
)
NUMERIC = ORIENTATIONS | frozenset(_NUMBERS.split())
LEAVES = frozenset({"joint", "freejoint", "inertial", "geom", "site", "connect", "weld"})
_SECTIONS = (
    "compiler option size statistic visual default extension custom asset worldbody deformable contact tendon "
    "equality actuator sensor keyframe"
)
SECTIONS = frozenset(_SECTIONS.split())
BODY_IGNORED = frozenset({"camera", "light", "plugin"})
BODY_UNSUPPORTED = frozenset({"attach", "composite", "flexcomp"})
