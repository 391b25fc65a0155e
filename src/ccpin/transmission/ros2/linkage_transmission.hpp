// @NAME@: @TITLE@ as a transmission of ros2_control. Written by ccpin.
//
// Between motors (actuators) and joints stands a closed chain. With J = dq_motors/dq_joints at a posture
//   actuator_to_joint: q_j(q_m),   v_j = J^-1 v_m,   tau_j = J^T tau_m    at the motors' positions,
//   joint_to_actuator: q_m(q_j),   v_m = J v_j       at the joints' positions (where they are no numbers: as efforts),
//                                  tau_m = J^-T tau_j where the motors were last read; before that, as velocities.
// An actuator is behind its gear: x_a = reduction q_m + offset, tau_a = tau_m / reduction. A joint is q_j + offset.
//
// What cannot be computed is refused: nothing is written, so that every handle keeps its last value, and the status
// goes to the joint handle "status", if there is one. One instance serves one robot; no heap, no locks of its own, no
// exceptions after configure().
#ifndef CCPIN_@NAME@_LINKAGE_TRANSMISSION_HPP
#define CCPIN_@NAME@_LINKAGE_TRANSMISSION_HPP

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "@NAME@/@NAME@_joints.h"
#include "@NAME@/@NAME@_motors.h"
#include "transmission_interface/transmission.hpp"

namespace @NAME@
{
constexpr std::size_t size = @N@;
constexpr std::array<const char *, size> joint_names{@JOINTS@};
constexpr std::array<const char *, size> motor_names{@MOTORS@};

enum Status : int { OK = 0, SINGULAR = 1, NOT_CONVERGED = 2, OUTSIDE = 3, NO_NUMBER = 4, TOO_FAR = 5 };

using Numbers = std::array<double, size>;

/// How one joint or actuator of the robot description stands to that of the linkage.
struct Axis
{
  std::string name;
  double reduction = 1.0;
  double offset = 0.0;
};

/// One side's map to the other, which goes on from its last posture.
template <std::size_t dependent>
class Map
{
public:
  using Function = int (*)(const double *, const double *, double *, double *, double *, double *);

  Map(Function function, const Numbers & q, const std::array<double, dependent> & y) : function_(function), q_(q), y_(y)
  {
  }

  /// Finds the posture at q; one step from the last one, or a walk there where the last one was refused.
  int find(const Numbers & q)
  {
    double far = 0.0;
    for (std::size_t k = 0; k < size; k++) {
      const double step = std::fabs(q[k] - q_[k]);
      if (!std::isfinite(step)) { return lost(NO_NUMBER); }
      far = step > far ? step : far;
    }
    if (!follows_ && far > stride * most) { return lost(TOO_FAR); }
    const int steps = follows_ ? 1 : 1 + static_cast<int>(far / stride);
    const Numbers start = q_;
    for (int step = 1; step <= steps; step++) {
      Numbers at = q;
      std::array<double, dependent> y;
      Numbers across;
      std::array<double, size * size> jacobian, inverse;
      for (std::size_t k = 0; k < size && step < steps; k++) { at[k] = start[k] + (q[k] - start[k]) * step / steps; }
      const int status = function_(at.data(), y_.data(), y.data(), across.data(), jacobian.data(), inverse.data());
      if (status != OK) { return lost(status); }
      q_ = at;
      y_ = y;
      across_ = across;
      jacobian_ = jacobian;
      inverse_ = inverse;
    }
    follows_ = known_ = true;
    return OK;
  }

  /// Whether there ever was a posture.
  bool known() const { return known_; }
  const Numbers & across() const { return across_; }

  /// Rates of the other side: M v, M = d(other side)/d(this side).
  Numbers rates(const Numbers & v) const { return times(jacobian_, v, false); }
  /// Efforts of the other side: M^-T tau, of the same power.
  Numbers efforts(const Numbers & tau) const { return times(inverse_, tau, true); }
  /// Efforts of this side, of the other's: M^T tau.
  Numbers efforts_back(const Numbers & tau) const { return times(jacobian_, tau, true); }
  /// Rates of this side, of the other's: M^-1 v.
  Numbers rates_back(const Numbers & v) const { return times(inverse_, v, false); }

private:
  static constexpr double stride = 0.02;  // rad or m, of a walk's steps
  static constexpr int most = 256;        // steps of a walk

  int lost(int status)
  {
    follows_ = false;
    return status;
  }

  static Numbers times(const std::array<double, size * size> & matrix, const Numbers & vector, bool transposed)
  {
    Numbers found{};
    for (std::size_t i = 0; i < size; i++) {
      for (std::size_t j = 0; j < size; j++) { found[i] += matrix[transposed ? j * size + i : i * size + j] * vector[j]; }
    }
    return found;
  }

  Function function_;
  Numbers q_;
  std::array<double, dependent> y_;
  Numbers across_{};
  std::array<double, size * size> jacobian_{}, inverse_{};
  bool follows_ = false, known_ = false;
};

class LinkageTransmission : public transmission_interface::Transmission
{
public:
  /// Joints and actuators in the order of joint_names and motor_names.
  LinkageTransmission(const std::array<Axis, size> & joints, const std::array<Axis, size> & actuators);

  /// Positions on both sides; velocities and efforts where both sides have them; a joint handle "status" if wanted.
  void configure(
    const std::vector<transmission_interface::JointHandle> & joint_handles,
    const std::vector<transmission_interface::ActuatorHandle> & actuator_handles) override;
  void actuator_to_joint() override;
  void joint_to_actuator() override;
  std::size_t num_actuators() const override { return size; }
  std::size_t num_joints() const override { return size; }

  /// Of the last call: 0, or why it wrote nothing.
  int status() const { return status_; }
  /// How many calls in a row were refused.
  long missed() const { return missed_; }

private:
  template <class Handle>
  struct Handles
  {
    std::vector<Handle> position, velocity, effort;
  };

  void tell(int status);

  std::array<Axis, size> joints_, actuators_;
  Handles<transmission_interface::JointHandle> joint_;
  Handles<transmission_interface::ActuatorHandle> actuator_;
  std::vector<transmission_interface::JointHandle> told_;
  Map<@N_Y_MOTORS@> measured_;
  Map<@N_Y_JOINTS@> commanded_;
  int status_ = OK;
  long missed_ = 0;
};
}  // namespace @NAME@

#endif
