// Ends with 0 where the plugin does, at postures found by ccpin, what ccpin found there.
#include <cmath>
#include <cstdio>
#include <limits>

#include "@NAME@/linkage_transmission.hpp"

using transmission_interface::ActuatorHandle;
using transmission_interface::JointHandle;

namespace
{
// Motors' positions, velocities and efforts, then the joints'.
constexpr std::size_t states = @STATES@;
const double table[states][6 * @NAME@::size] = {
@TABLE@
};

bool near(const std::array<double, 3 * @NAME@::size> & found, const double * wanted)
{
  bool good = true;
  for (std::size_t k = 0; k < found.size(); k++) {
    good = good && std::fabs(found[k] - wanted[k]) <= 1e-9 * (1.0 + std::fabs(wanted[k]));
  }
  return good;
}
}  // namespace

int main()
{
  constexpr std::size_t n = @NAME@::size;
  std::array<@NAME@::Axis, n> joints, motors;
  std::array<double, 3 * n> joint{}, motor{};
  double status = 0.0;
  std::vector<JointHandle> joint_handles;
  std::vector<ActuatorHandle> motor_handles;
  const char * interfaces[3] = {"position", "velocity", "effort"};
  for (std::size_t k = 0; k < n; k++) {
    joints[k].name = @NAME@::joint_names[k];
    motors[k].name = @NAME@::motor_names[k];
    for (std::size_t i = 0; i < 3; i++) {
      joint_handles.emplace_back(joints[k].name, interfaces[i], &joint[i * n + k]);
      motor_handles.emplace_back(motors[k].name, interfaces[i], &motor[i * n + k]);
    }
  }
  joint_handles.emplace_back(joints[0].name, "status", &status);
  @NAME@::LinkageTransmission transmission(joints, motors);
  transmission.configure(joint_handles, motor_handles);
  int failures = 0;
  for (std::size_t s = 0; s < states; s++) {
    for (std::size_t k = 0; k < 3 * n; k++) { motor[k] = table[s][k]; }
    transmission.actuator_to_joint();
    failures += !(status <= 0.0) || !near(joint, table[s] + 3 * n);
    motor.fill(0.0);
    transmission.joint_to_actuator();
    failures += !(status <= 0.0) || !near(motor, table[s]);
    const auto told = joint;  // no number is refused, and nothing is written
    motor[0] = std::numeric_limits<double>::quiet_NaN();
    transmission.actuator_to_joint();
    failures += !(status > 0.0) || told != joint || transmission.missed() != 1;
  }
  std::printf("@NAME@: %d of %zu checks failed\n", failures, 3 * states);
  return failures != 0;
}
