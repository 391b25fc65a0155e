"""Where σ is unique and nonsingular: Theorem 2, certificates, atlas, singularities."""

from __future__ import annotations

from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.cells import CellStatus, Region
from ccpin.domain.atlas.merging import split_region
from ccpin.domain.atlas.radius_map import certified_radius
from ccpin.domain.atlas.run import Work
from ccpin.domain.atlas.survey import certify
from ccpin.domain.closures.seeds import scalar_coordinates_at
from ccpin.domain.closures.task_space import JointSpace
from ccpin.domain.curves.cover import CrossedCells, SingularCover, UncoveredBoxes
from ccpin.domain.curves.curve import CertifiedCurve
from ccpin.domain.curves.curves import certify_singularities
from ccpin.domain.cusps import Cusp, cusps
from ccpin.domain.design import Design, design, scaled_links
from ccpin.domain.largest import LargestWorkspace, largest_ball, largest_cube
from ccpin.domain.merging import merge
from ccpin.domain.one_box import kantorovich_radius, newton_steps
from ccpin.domain.path import CertifiedPath, certify_path
from ccpin.domain.sheets.search import certify_sheets
from ccpin.domain.sheets.sheets import ModeChange, Sheet, SheetAtlas
from ccpin.domain.sheets.touching import Fold
from ccpin.domain.singularities import (
    SingularCurve,
    SingularityDistance,
    serial_singularities,
    singularities,
    singularity_distance,
)
from ccpin.domain.theorem2.system import QuadraticSystem
from ccpin.domain.theorem2.theorem2 import Theorem2Result, theorem2, theorem2_radius
from ccpin.domain.workspace import certify_workspace

__all__ = [
    "Atlas",
    "CellStatus",
    "CertifiedCurve",
    "CertifiedPath",
    "CrossedCells",
    "Cusp",
    "Design",
    "Fold",
    "JointSpace",
    "LargestWorkspace",
    "ModeChange",
    "QuadraticSystem",
    "Region",
    "Sheet",
    "SheetAtlas",
    "SingularCover",
    "SingularCurve",
    "SingularityDistance",
    "Theorem2Result",
    "UncoveredBoxes",
    "Work",
    "certified_radius",
    "certify",
    "certify_path",
    "certify_sheets",
    "certify_singularities",
    "certify_workspace",
    "cusps",
    "design",
    "kantorovich_radius",
    "largest_ball",
    "largest_cube",
    "merge",
    "newton_steps",
    "scalar_coordinates_at",
    "scaled_links",
    "serial_singularities",
    "singularities",
    "singularity_distance",
    "split_region",
    "theorem2",
    "theorem2_radius",
]
