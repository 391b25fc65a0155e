"""The plugin of ros2_control compiled with every warning an error, and driven; commands for it, as Python has them."""

import ctypes
import subprocess
from typing import NamedTuple

import numpy as np

from tests.support.exported import compiler
from tests.support.linkage_models import FORMS

WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror")
STRICT = ("-std=c++17", "-O2", *WARNINGS, "-ffp-contract=off")
DRIVER = """
#include <chrono>
#include <memory>
#include "{name}/linkage_transmission.hpp"
#include "hardware_interface/hardware_info.hpp"
#include "../src/loader.cpp"

namespace
{{
// In another order than the linkage's, under names of the robot's own.
hardware_interface::TransmissionInfo described(double reduction, double offset)
{{
  hardware_interface::TransmissionInfo stated;
  stated.name = "one";
  for (std::size_t k = {name}::size; k-- > 0;) {{
    hardware_interface::JointInfo joint;
    joint.name = std::string("robot_") + {name}::joint_names[k];
    joint.role = {name}::joint_names[k];
    joint.offset = offset;
    stated.joints.push_back(joint);
    hardware_interface::ActuatorInfo actuator;
    actuator.name = {name}::motor_names[k];
    actuator.mechanical_reduction = reduction;
    stated.actuators.push_back(actuator);
  }}
  return stated;
}}
}}  // namespace

// Whether a description with so many of the actuators is taken.
extern "C" int loads(long actuators)
{{
  auto stated = described(1.0, 0.0);
  stated.actuators.resize(static_cast<std::size_t>(actuators));
  return {name}::LinkageTransmissionLoader().load(stated) != nullptr;
}}

// Rows of motors' positions, velocities, efforts, then what is commanded of the joints: positions, velocities, efforts.
// Out: the joints' three and the motors' three, the status after each way. Returns seconds a row.
extern "C" double drive(long rows, const double * in, double * out, double * status, double reduction, double offset)
{{
  using namespace {name};
  double told = 0.0;
  std::array<double, 3 * size> joint{{}}, motor{{}};
  std::vector<transmission_interface::JointHandle> joints;
  std::vector<transmission_interface::ActuatorHandle> motors;
  const char * interfaces[3] = {{"position", "velocity", "effort"}};
  for (std::size_t k = size; k-- > 0;) {{
    for (std::size_t i = 0; i < 3; i++) {{
      joints.emplace_back(std::string("robot_") + joint_names[k], interfaces[i], &joint[i * size + k]);
      motors.emplace_back(motor_names[k], interfaces[i], &motor[i * size + k]);
    }}
  }}
  joints.emplace_back("one", "status", &told);
  const auto transmission = LinkageTransmissionLoader().load(described(reduction, offset));
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


class Driven(NamedTuple):
    """A plugin that is loaded: rows of commands in, rows of answers, statuses and seconds a row out."""

    library: ctypes.CDLL
    width: int

    def __call__(self, rows, reduction=1.0, offset=0.0):
        """Actuators behind gears, joints with offsets."""
        given = np.ascontiguousarray(rows, dtype=np.float64)
        out, status = np.empty((len(given), self.width)), np.empty((len(given), 2))
        arrays = [ctypes.c_void_p(each.ctypes.data) for each in (given, out, status)]
        scales = ctypes.c_double(reduction), ctypes.c_double(offset)
        return out, status, self.library.drive(ctypes.c_long(len(given)), *arrays, *scales)

    def loads(self, actuators):
        """Whether a description with so many actuators is taken."""
        return bool(self.library.loads(ctypes.c_long(actuators)))


def built(made, folder, name):
    """The plugin that was exported into a folder, compiled with its driver."""
    (folder / "test" / "drive.cpp").write_text(DRIVER.format(name=name))
    library = folder / "drive.so"
    sources = [str(folder / "src" / "linkage_transmission.cpp"), str(folder / "test" / "drive.cpp")]
    places = [f"-I{folder / 'include'}", f"-I{folder / 'declared'}"]
    subprocess.run([compiler("g++"), *STRICT, *places, "-shared", "-fPIC", *sources, "-o", str(library)], check=True)
    loaded = ctypes.CDLL(str(library))
    loaded.drive.restype = ctypes.c_double
    return Driven(loaded, 6 * made.n)


def walk(name, count, size):
    """q_j along a closed curve that begins at the reference."""
    low, high = FORMS[name].RANGE.T
    phase = np.linspace(0.0, 2.0 * np.pi, count)[:, None] * np.arange(1, len(low) + 1)
    return size * 0.5 * (high - low) * np.sin(phase)


def in_python(made, q):
    """Rows for `run` that command the postures q, and what the package makes of them."""
    rng, near = np.random.default_rng(5), None
    rows, expected = np.empty((2, len(q), 6 * made.n))
    for k, (v, tau, v_joint, tau_joint) in enumerate(rng.normal(size=(len(q), 4, made.n))):
        near = posture = made.at(q[k], near)
        rows[k] = np.concatenate([posture.q_motor, v, tau, q[k], v_joint, tau_joint])
        joints = q[k], posture.joint_velocity(v), posture.joint_effort(tau)
        motors = posture.q_motor, posture.motor_velocity(v_joint), posture.motor_effort(tau_joint)
        expected[k] = np.concatenate([*joints, *motors])
    return rows, expected
