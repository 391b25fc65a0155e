"""Where σ is unique and nonsingular: Theorem 2, certificates, singularities."""

from __future__ import annotations

from ccpin.domain.kantorovich import kantorovich_radius
from ccpin.domain.quadratic import QuadraticSystem
from ccpin.domain.singularities import SingularCurve, singularities, singularity_distance
from ccpin.domain.theorem2 import Theorem2Result, theorem2, theorem2_radius

__all__ = [
    "QuadraticSystem",
    "SingularCurve",
    "Theorem2Result",
    "kantorovich_radius",
    "singularities",
    "singularity_distance",
    "theorem2",
    "theorem2_radius",
]
