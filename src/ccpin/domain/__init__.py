"""Where σ is unique and nonsingular: Theorem 2, certificates, atlas, singularities."""

from __future__ import annotations

from ccpin.domain.atlas.atlas import Atlas, certify
from ccpin.domain.atlas.cells import CellStatus, Region
from ccpin.domain.atlas.radius_map import certified_radius
from ccpin.domain.chains import scalar_coordinates_at
from ccpin.domain.cusps import Cusp, cusps
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

__all__ = [
    "Atlas",
    "CellStatus",
    "CertifiedPath",
    "Cusp",
    "Fold",
    "ModeChange",
    "QuadraticSystem",
    "Region",
    "Sheet",
    "SheetAtlas",
    "SingularCurve",
    "SingularityDistance",
    "Theorem2Result",
    "certified_radius",
    "certify",
    "certify_path",
    "certify_sheets",
    "cusps",
    "kantorovich_radius",
    "newton_steps",
    "scalar_coordinates_at",
    "serial_singularities",
    "singularities",
    "singularity_distance",
    "theorem2",
    "theorem2_radius",
]
