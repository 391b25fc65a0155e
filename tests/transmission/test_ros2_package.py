"""The plugin of ros2_control: no warning, commands by the hundred thousand as Python has them, refusals."""

import ctypes
import shutil
import subprocess
import xml.etree.ElementTree as ElementTree
from functools import cache

import numpy as np
import pytest

from ccpin.errors import InvalidInputError
from ccpin.transmission import Transmission, export_ros2
from tests.support.exported import compiler
from tests.support.linkage_models import FORMS, transmission_of

STRICT = ("-std=c++17", "-O2", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-ffp-contract=off")
DRIVER = """
#include <chrono>
#include <memory>
#include "{name}/linkage_transmission.hpp"
#include "hardware_interface/hardware_info.hpp"
#include "../src/loader.cpp"

// Rows of motors' positions, velocities, efforts, then what is commanded of the joints: positions, velocities, efforts.
// Out: the joints' three and the motors' three, the status after each way. Returns seconds a row, or less than 0.
extern "C" double drive(long rows, const double * in, double * out, double * status, double reduction, double offset)
{{
  using namespace {name};
  hardware_interface::TransmissionInfo stated;
  stated.name = "one";
  double told = 0.0;
  std::array<double, 3 * size> joint{{}}, motor{{}};
  std::vector<transmission_interface::JointHandle> joints;
  std::vector<transmission_interface::ActuatorHandle> motors;
  const char * interfaces[3] = {{"position", "velocity", "effort"}};
  for (std::size_t k = size; k-- > 0;) {{   // in another order than the linkage's, under names of the robot's own
    hardware_interface::JointInfo one;
    one.name = std::string("robot_") + joint_names[k];
    one.role = joint_names[k];
    one.offset = offset;
    hardware_interface::ActuatorInfo other;
    other.name = motor_names[k];
    other.mechanical_reduction = reduction;
    stated.joints.push_back(one);
    stated.actuators.push_back(other);
    for (std::size_t i = 0; i < 3; i++) {{
      joints.emplace_back(one.name, interfaces[i], &joint[i * size + k]);
      motors.emplace_back(other.name, interfaces[i], &motor[i * size + k]);
    }}
  }}
  joints.emplace_back("one", "status", &told);
  LinkageTransmissionLoader loader;
  stated.actuators.pop_back();
  if (loader.load(stated)) {{ return -1.0; }}
  hardware_interface::ActuatorInfo first;
  first.name = motor_names[0];
  first.mechanical_reduction = reduction;
  stated.actuators.push_back(first);
  const auto transmission = loader.load(stated);
  if (!transmission) {{ return -2.0; }}
  transmission->configure(joints, motors);
  const auto begin = std::chrono::steady_clock::now();
  for (long row = 0; row < rows; row++, in += 6 * size, out += 6 * size, status += 2) {{
    for (std::size_t k = 0; k < 3 * size; k++) {{ motor[k] = in[k]; }}
    transmission->actuator_to_joint();
    status[0] = told;
    for (std::size_t k = 0; k < 3 * size; k++) {{ out[k] = joint[k]; }}
    for (std::size_t k = 0; k < 3 * size; k++) {{ joint[k] = in[3 * size + k]; }}
    transmission->joint_to_actuator();
    status[1] = told;
    for (std::size_t k = 0; k < 3 * size; k++) {{ out[3 * size + k] = motor[k]; }}
  }}
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count() / static_cast<double>(rows);
}}
"""


def built(name, folder, **options):
    """The plugin of a transmission with a driver: rows of commands in, rows of answers and statuses out."""
    made = transmission_of(name)
    export_ros2(made, folder, name=name, **options)
    (folder / "test" / "drive.cpp").write_text(DRIVER.format(name=name))
    library, width = folder / "drive.so", 6 * made.n
    sources = [str(folder / "src" / "linkage_transmission.cpp"), str(folder / "test" / "drive.cpp")]
    places = [f"-I{folder / 'include'}", f"-I{folder / 'declared'}"]
    subprocess.run([compiler("g++"), *STRICT, *places, "-shared", "-fPIC", *sources, "-o", str(library)], check=True)
    drive = ctypes.CDLL(str(library)).drive
    drive.restype = ctypes.c_double

    def run(rows, reduction=1.0, offset=0.0):
        given = np.ascontiguousarray(rows, dtype=np.float64)
        out, status = np.empty((len(given), width)), np.empty((len(given), 2))
        arrays = [ctypes.c_void_p(each.ctypes.data) for each in (given, out, status)]
        scales = ctypes.c_double(reduction), ctypes.c_double(offset)
        return out, status, drive(ctypes.c_long(len(given)), *arrays, *scales)

    return run


def walk(name, count, size):
    """q_j along a closed curve that begins at the reference."""
    low, high = FORMS[name].RANGE.T
    phase = np.linspace(0.0, 2.0 * np.pi, count)[:, None] * np.arange(1, len(low) + 1)
    return size * 0.5 * (high - low) * np.sin(phase)


def commands(name, count, size):
    """Rows for `drive`, and what the closed form makes of them."""
    form, rng, n = FORMS[name], np.random.default_rng(5), transmission_of(name).n
    q, wanted = walk(name, count, size), walk(name, count, 0.8 * size)
    v, tau, v_wanted, tau_wanted = rng.normal(size=(4, count, n))
    rows, expected = [], []
    for k in range(count):
        J, J_wanted = form.jacobian(q[k]), form.jacobian(wanted[k])
        rows.append([*form.motors(q[k]), *v[k], *tau[k], *wanted[k], *v_wanted[k], *tau_wanted[k]])
        joints = [*q[k], *np.linalg.solve(J, v[k]), *(J.T @ tau[k])]
        motors = [*form.motors(wanted[k]), *(J_wanted @ v_wanted[k]), *np.linalg.solve(J.T, tau_wanted[k])]
        expected.append([*joints, *motors])
    return np.array(rows), np.array(expected)


@cache
def scale(n, reduction):
    """What a gear makes of motors' positions, velocities and efforts."""
    return np.repeat([reduction, reduction, 1.0 / reduction], n)


@pytest.fixture(scope="module")
def knee(tmp_path_factory):
    """The knee's plugin, proved from -0.3 to 0.3 rad."""
    pytest.importorskip("flint")
    return built("knee", tmp_path_factory.mktemp("knee"), region=([-0.3], [0.3]), max_cells=64)


def require_both_ways(run, name, size):
    """Positions, velocities and efforts, by gears and offsets, in the robot's order; the description is held to it."""
    n = transmission_of(name).n
    rows, expected = commands(name, 500, size)
    for reduction, offset in ((1.0, 0.0), (-9.0, 0.25)):
        given, wanted = rows.copy(), expected.copy()
        given[:, : 3 * n] *= scale(n, reduction)
        given[:, 3 * n : 4 * n] += offset
        wanted[:, 3 * n :] *= scale(n, reduction)
        wanted[:, :n] += offset
        out, status, seconds = run(given, reduction, offset)
        assert seconds > 0
        assert (status == 0).all()
        np.testing.assert_allclose(out, wanted, rtol=1e-9, atol=1e-10)


def test_commands_both_ways_are_the_closed_form_s(knee):
    """Of the knee, where its region is proved."""
    require_both_ways(knee, "knee", 0.4)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["knee", "neck", "ankle"])
def test_commands_both_ways_with_nothing_proved(name, tmp_path):
    """Of all three."""
    require_both_ways(built(name, tmp_path), name, 0.6)


def test_what_cannot_be_computed_is_refused(knee):
    """No numbers and what is outside: a status, and the last values; efforts go on alone; a good sample is taken."""
    rows, expected = commands("knee", 40, 0.4)
    bad, form = rows.copy(), FORMS["knee"]
    bad[10, 0], bad[12, 1], bad[14, 2], bad[16, 3], bad[18, 4] = np.nan, np.inf, np.nan, np.nan, np.nan
    bad[20, 0], bad[22, 0], bad[24, 3] = 1e9, form.motors(np.array([0.35]))[0], 0.3001
    out, status, _ = knee(bad)
    refused = {10: 4, 12: 4, 14: 4, 20: 3, 22: 3}
    assert {int(k): int(status[k, 0]) for k in np.flatnonzero(status[:, 0])} == refused
    assert {int(k): int(status[k, 1]) for k in np.flatnonzero(status[:, 1])} == {18: 4, 24: 3}
    for k in refused:  # what was there: the joints' commands of the tick before
        np.testing.assert_array_equal(out[k, :3], bad[k - 1, 3:])
    for k in (18, 24):
        np.testing.assert_array_equal(out[k, 3:], bad[k, :3])
    assert out[16, 3] == bad[16, 0]  # no position is commanded, and none is written
    J = form.jacobian(np.array([expected[16, 0]]))[0, 0]
    np.testing.assert_allclose(out[16, 4:], [J * bad[16, 4], bad[16, 5] / J], rtol=1e-9)
    good = np.setdiff1d(np.arange(40), [16, 18, 24, *refused])
    np.testing.assert_allclose(out[good], expected[good], rtol=1e-9, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["knee", "ankle"])
def test_a_hundred_thousand_commands(name, tmp_path):
    """Equal to Python within 1e-12 of their size (times J's condition), at less than 5 µs a cycle."""
    found, count = transmission_of(name), 100_000
    run, n = built(name, tmp_path), found.n
    rng = np.random.default_rng(5)
    rows = np.empty((count, 6 * n))
    q, near = walk(name, count, 0.6), None
    rest = rng.normal(size=(count, 4, n))
    expected, size = np.empty((count, 6 * n)), np.empty(count)
    for k in range(count):
        near = posture = found.at(q[k], near)
        v, tau, v_joint, tau_joint = rest[k]
        rows[k] = np.concatenate([posture.q_motor, v, tau, q[k], v_joint, tau_joint])
        joints = q[k], posture.joint_velocity(v), posture.joint_effort(tau)
        motors = posture.q_motor, posture.motor_velocity(v_joint), posture.motor_effort(tau_joint)
        expected[k], size[k] = np.concatenate([*joints, *motors]), 1.0 / posture.rcond
    out, status, seconds = run(rows)
    assert (status == 0).all()
    assert (np.abs(out - expected) <= 1e-12 * size[:, None] * np.maximum(1.0, np.abs(expected))).all()
    assert seconds < 5e-6


@pytest.mark.slow
def test_cmake_builds_and_tests_it(tmp_path):
    """The package as it is written, by CMake and CTest, against the declarations."""
    if shutil.which("cmake") is None:
        pytest.skip("there is no cmake here")
    compiler("g++")
    export_ros2(transmission_of("neck"), tmp_path / "package", name="neck_linkage")
    build = tmp_path / "build"
    subprocess.run(["cmake", "-S", str(tmp_path / "package"), "-B", str(build)], check=True)
    subprocess.run(["cmake", "--build", str(build)], check=True)
    subprocess.run(["ctest", "--test-dir", str(build), "--output-on-failure"], check=True)


def test_the_package_names_what_is_loaded(tmp_path):
    """The plugin's class is the one that is registered; roles are the linkage's; names are a package's."""
    found = transmission_of("neck")
    paths = export_ros2(found, tmp_path, name="my_neck")
    assert all(path.is_file() and "@" not in path.read_text().replace("todo@todo.todo", "") for path in paths)
    stated = ElementTree.parse(tmp_path / "my_neck.xml").getroot()[0]
    assert (
        f"PLUGINLIB_EXPORT_CLASS({stated.get('type')}, {stated.get('base_class_type')})"
        in (tmp_path / "src" / "loader.cpp").read_text()
    )
    element = ElementTree.parse(tmp_path / "robot.xml").getroot()
    assert element.findtext("plugin") == stated.get("name")
    assert [each.get("role") for each in element.iter("joint")] == list(found.joints)
    assert [each.get("role") for each in element.iter("actuator")] == list(found.motors)
    for name in ("Neck", "my__neck", "neck_", "1neck", "n", "my neck"):
        with pytest.raises(InvalidInputError, match="name must be a package's"):
            export_ros2(found, tmp_path, name=name)
    with pytest.raises(InvalidInputError, match="must be below"):
        export_ros2(found, tmp_path, region=([0.1, 0.1], [0.1, 0.2]))
    direct = Transmission(found.motor_model, joints=found.motors, motors=found.motors)
    with pytest.raises(InvalidInputError, match="motors are the joints"):
        export_ros2(direct, tmp_path)
