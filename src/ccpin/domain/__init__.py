"""Where σ is unique and nonsingular: Theorem 2, certificates, atlas, singularities."""

from __future__ import annotations

from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.certifying import certify
from ccpin.domain.atlas.merged import split_region
from ccpin.domain.atlas.radius_map import certified_radius
from ccpin.domain.atlas.square import kantorovich_radius
from ccpin.domain.closures.seeds import scalar_coordinates_at
from ccpin.domain.closures.task_coordinates import JointSpace
from ccpin.domain.merging import merge
from ccpin.domain.paths.path import certify_path
from ccpin.domain.sheets.certifying import certify_sheets
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.domain.singular.certifying import certify_singularities
from ccpin.domain.singular.curves import SingularCover
from ccpin.domain.singular.cusp_points import cusps
from ccpin.domain.singular.sampled import serial_singularities, singularities, singularity_distance
from ccpin.domain.theorem2.radius import theorem2
from ccpin.domain.workspaces.largest import largest_ball, largest_cube
from ccpin.domain.workspaces.synthesis import design, scaled_links
from ccpin.domain.workspaces.workspace import certify_workspace

__all__ = [
    "Atlas",
    "JointSpace",
    "SheetAtlas",
    "SingularCover",
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
    "scalar_coordinates_at",
    "scaled_links",
    "serial_singularities",
    "singularities",
    "singularity_distance",
    "split_region",
    "theorem2",
]
__dir__ = __all__.copy
