"""What commands there are, in the order in which help lists them: the module of each is loaded when it is called."""

from __future__ import annotations

from typing import NamedTuple


class Command(NamedTuple):
    """A command: the module of this folder whose ``add_`` and its name adds it, and what it does."""

    module: str
    what: str


COMMANDS: dict[str, Command] = {
    "new": Command("new", "a URDF to start from, with loops, masses, limits and motors that its lengths suggest"),
    "info": Command("info", "what was loaded: sizes, mobility, joints, conditioning"),
    "check": Command(
        "check",
        "whether a file's loops close, what moves, what drives it, what is wrong (exit code 4) or doubtful (3)",
    ),
    "modes": Command("info", "the assembly modes over a given q"),
    "transmission": Command(
        "transmission", "from motors to joints through the closed chain: ratios, rotor inertia, limits, shortcuts"
    ),
    "excite": Command(
        "excite", "a motion along which the constants of the mechanism show, within limits, on its branch"
    ),
    "identify": Command("identify", "masses, inertias, friction from logs: with deviations, as a file and a page"),
    "simulate": Command("simulate", "a set-point motion, once or in cycles, with figures and data"),
    "domain": Command("domain", "where the model holds: certified radii, an atlas, singular curves"),
    "merge": Command(
        "merge",
        "put saved atlases, sheets, or singular curves of the parts of a region together: atlases (of "
        "one branch) and sheets whose regions are got by halving one box, curves whose regions fill one",
    ),
    "verify": Command(
        "verify",
        "check a saved atlas or cover in ball arithmetic, by code of its own (exit code 3: a claim is "
        "not decided; 4: one is refuted)",
    ),
    "view": Command("view", "show the mechanism, or play a trajectory, in MeshCat"),
    "studio": Command("studio", "move the mechanism by hand in the browser, with map and experiments"),
    "convert": Command("convert", "write the mechanism as URDF+, SDFormat, MJCF or a toolbox robot.yaml"),
    "export": Command("export", "write what the model computes as straight-line C99 for firmware, or as JSON"),
    "report": Command(
        "report",
        "one offline page about a mechanism: what it is, where it holds, modes, an experiment, its animation "
        "(takes about ten seconds)",
    ),
    "paper": Command("paper", "every equation, figure and table of the paper beside ccpin's, as one offline page"),
    "doctor": Command(
        "doctor",
        "versions, cores, compiled core, compiler, browser, and a mechanism's meshes where one is named",
    ),
    "examples": Command(
        "examples",
        "examples that run as they stand: of every command, and the scripts and how-to pages of a checkout",
    ),
}
