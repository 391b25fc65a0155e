"""A new closure kind is one entry of the table: readers, σ, dynamics, forces, certificates and tapes follow.

The kind is a pin in a straight slot: the origin of frame B stays on the x axis of frame A. With it a crank and a rod
make a slider-crank without a slider: a sin q₁ + b sin(q₁ + q₂) = 0.
"""

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.description import CLOSURE_KINDS
from ccpin.description.closure_kinds import GAP, Fixed, LoopRows, Product, Y, Z
from ccpin.domain import theorem2
from tests.oracles.finite_differences import assert_close, derivative

CRANK, ROD = 0.2, 0.5
FILE = f"""
<robot name="pin_in_slot">
  <link name="base"/>
  <link name="crank"><inertial><origin xyz="0.1 0 0"/><mass value="0.4"/>
    <inertia ixx="1e-3" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="rod"><inertial><origin xyz="0.25 0 0"/><mass value="0.6"/>
    <inertia ixx="1e-3" iyy="9e-3" izz="9e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/>
    <limit lower="-9" upper="9" effort="9" velocity="9"/></joint>
  <joint name="elbow" type="revolute" independent="false"><parent link="crank"/><child link="rod"/>
    <origin xyz="{CRANK} 0 0"/><axis xyz="0 0 1"/><limit lower="-9" upper="9" effort="9" velocity="9"/></joint>
  <loop name="slot" type="slot">
    <predecessor link="base"/><successor link="rod"><origin xyz="{ROD} 0 0"/></successor>
  </loop>
</robot>
"""


def slot(closure, normal):
    """y_A·gap = 0 and z_A·gap = 0."""
    return LoopRows(tuple((Product(1.0, Fixed("A", axis), GAP),) for axis in (Y, Z)))


@pytest.fixture
def mechanism(monkeypatch, tmp_path):
    """The slider-crank, with the new kind in the table."""
    monkeypatch.setitem(CLOSURE_KINDS, "slot", slot)
    path = tmp_path / "slot.urdf"
    path.write_text(FILE)
    return ccpin.load(path)


def elbow(q):
    """q₂ of the closed form, on the branch with the rod pointing along +x."""
    return -np.arcsin(CRANK / ROD * np.sin(q)) - q


def test_the_table_is_all_it_takes(mechanism):
    """σ, ρ and the equations of motion by the closed form; the plane's row is dropped by proof."""
    assert mechanism.constraints().size == 1
    model = ccpin.ReducedModel(mechanism)
    for q in np.linspace(-1.4, 1.4, 9):
        q_free = model.sigma([q])
        assert_close(q_free, np.array([q, elbow(q)]), 1e-12, scale=1.0)
        slope = derivative(lambda s, q=q: elbow(q + s))
        assert_close(model.rho(q_free)[:, 0], np.array([1.0, slope]), 1e-8)
        v, u = np.array([0.7]), np.array([0.3])
        a = model.forward_dynamics([q], v, u)
        power = derivative(lambda s, q=q, v=v, a=a: sum(model.energy([q + s * v[0]], v + s * a)))
        assert power == pytest.approx(u[0] * v[0], abs=1e-7)


def test_certificates_and_forces_follow(mechanism):
    """Bounds, atlas and the wrench in the slot, which does no work along it."""
    model = ccpin.ReducedModel(mechanism)
    assert theorem2(mechanism, mechanism.q_reference).radius > 0
    assert domain.kantorovich_radius(mechanism, mechanism.q_reference) > 0
    path = domain.certify_path(mechanism, [[-0.5], [0.5]], tube=0.01)
    assert path.verdict == "proven"
    assert_close(path.sigma(0.5), np.array([0.0, elbow(0.0)]), 1e-12, scale=1.0)
    (load,) = ccpin.simulation.results.forces.closure_forces_at(model, [0.4], [0.2], [0.1])
    assert load.force[0, 0] == pytest.approx(0.0, abs=1e-12)
    assert abs(load.force[0, 1]) > 1e-3
