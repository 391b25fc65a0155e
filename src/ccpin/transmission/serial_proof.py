"""How far a serial robot is from the mechanism at most, all over a region, and how fast its motors are: proved.

Both are recorded as one program, whose ranges over the region are proved (Theorems Q and E, `certify_program`).
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import UnsupportedMechanismError
from ccpin.programs.program import Port, Program
from ccpin.programs.quantities import QUANTITIES, Quantity, TapedModel, along, damping, taped_model
from ccpin.programs.recording.recorded_mechanism import numbering
from ccpin.programs.recording.recorded_tree import Table, rational
from ccpin.programs.recordings import program_of
from ccpin.transmission.serial_misfits import SerialErrors
from ccpin.transmission.transmission import Transmission
from ccpin.validated.programs.program_certificate import ProgramCertificate

_OUT = 1.0 + 2.0**-40  # on bounds made of some sums and products of doubles that are not negative
_DIFFERENCES = {"mass": QUANTITIES["mass"], "gravity": QUANTITIES["gravity"], "damping": Quantity("", (), damping)}


def compare_over(
    added: ReducedModel, transmission: Transmission, region: tuple[Array, Array], max_cells: int
) -> ProgramCertificate | None:
    """What is proved of their differences over a region; ``None`` where what proves has no words for it.

    Args:
        added: What was added to the serial robot, alone, in the mechanism's coordinates.
        transmission: What it stands for.
        region: Lower and upper q_j.
        max_cells: Of `certify_program`.

    Raises:
        CcpinError: What proves is not installed.
    """
    from ccpin.validated import certify_program  # with python-flint

    program = differences(added, transmission)
    try:
        return certify_program(program, region, bounds={}, formats=("double",), max_cells=max_cells)
    except UnsupportedMechanismError:
        return None


def differences(added: ReducedModel, transmission: Transmission) -> Program:
    """D_s − D, g_s − g, that of damping, Christoffel's symbols, D⁻¹(D_s − D), and ρ.

    The serial robot's own links are in both and recorded in neither: E = D_s − D is what was added less the linkage.
    The symbols are ½(∂_k E_ij + ∂_j E_ik − ∂_i E_jk): C_s q̇ − C q̇ is their form in q̇.
    """
    whole = transmission.joint_model
    about = transmission.reference.state
    own = numbering(whole, about.q_free)
    scene, more, less = (
        taped_model(model, own, about.q_free, None, {}) for model in (whole, added, transmission.linkage)
    )
    outputs = {name: _on(scene, more, each) - _on(scene, less, each) for name, each in _DIFFERENCES.items()}
    by_q = along(scene, outputs["mass"], "q")
    outputs["symbols"] = (by_q + by_q.transpose(0, 2, 1) - by_q.transpose(2, 0, 1)) * rational(0.5)
    outputs["relative"] = scene.tape.solve(QUANTITIES["mass"].record(scene), outputs["mass"])
    outputs["rho"] = scene.recorded.motion.rho
    shown = tuple(Port(name, table.shape, "", tuple(map(str, range(table.size)))) for name, table in outputs.items())
    return program_of(scene, about, f"{whole.mechanism.name}: beside a serial robot", outputs, shown)


def errors_of(certificate: ProgramCertificate) -> SerialErrors:
    """Bounds of all differences over the region, of the serial robot before its numbers are rounded to doubles.

    The eigenvalues of D⁻¹E are those that |vᵀEv| ≤ share · vᵀDv asks about: no larger than Perron's of its bounds.
    """
    most = largest(certificate)
    velocity = np.array([spectral_bound(0.5 * (each + each.T)) for each in most["symbols"]])
    return SerialErrors(most["mass"], spectral_bound(most["relative"]), velocity, most["gravity"], most["damping"])


def largest(certificate: ProgramCertificate) -> dict[str, Array]:
    """Bounds of absolute values over the region, by name."""
    return {name: np.maximum(np.abs(low), np.abs(high)) for name, (low, high) in certificate.ranges().items()}


def _on(scene: TapedModel, other: TapedModel, quantity: Quantity) -> Table:
    """A quantity of another model of the same numbers, on a scene's tape."""
    table = quantity.record(other)
    entries = scene.tape.inlined(other.tape.code(table.ravel().tolist()), scene.tape.inputs)
    return np.array(entries, dtype=object).reshape(table.shape)


def spectral_bound(bounds: Array) -> float:
    """No less than the spectral radius of any matrix within ± bounds: max (Bx)_i/x_i for some x > 0 (Collatz)."""
    if not bounds.any():
        return 0.0
    x = np.ones(len(bounds))
    for _ in range(50):
        x = bounds @ x + 1e-6 * x
        x = x / x.max() + 1e-12
    return float((bounds @ x / x).max() * _OUT)
