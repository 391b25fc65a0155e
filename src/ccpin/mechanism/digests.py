"""The digests of a mechanism: the numbers that enter φ, the dynamics, and what a simulated plant reads besides."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ccpin.proof.digests import Digests, digest

if TYPE_CHECKING:
    from ccpin.mechanism.mechanism import Mechanism


def mechanism_digests(mechanism: Mechanism) -> Digests:
    """Digests of closures and independent coordinates, of dynamics without gravity, and of the plant."""
    tree, physics, motors = mechanism.tree, mechanism.joints, mechanism.motors
    closures = (*mechanism.closures, *mechanism.locks)
    masses: list[Any] = [(body.mass, body.lever, body.inertia) for body in tree.model.inertias]
    moved = ("damping", "stiffness", "spring_reference", "armature")
    kept = ("friction", "effort", "velocity")
    return Digests(
        name=f"mechanism '{mechanism.name}'",
        closures=digest((tree, closures, mechanism.couplings, mechanism.independent)),
        dynamics=digest((masses, {name: getattr(physics, name) for name in moved}, mechanism.actuated, motors.gears)),
        plant=digest(({name: getattr(physics, name) for name in kept}, mechanism.position_limits, motors.limits)),
    )
