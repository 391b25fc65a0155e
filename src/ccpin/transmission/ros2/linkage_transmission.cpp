#include "@NAME@/linkage_transmission.hpp"

#include "transmission_interface/exception.hpp"

namespace @NAME@
{
namespace
{
template <class Handle>
Numbers read(const std::vector<Handle> & handles)
{
  Numbers found{};
  for (std::size_t k = 0; k < handles.size(); k++) { found[k] = handles[k].get_value(); }
  return found;
}

template <class Handle>
void write(std::vector<Handle> & handles, const Numbers & numbers)
{
  for (std::size_t k = 0; k < handles.size(); k++) { static_cast<void>(handles[k].set_value(numbers[k])); }
}

bool finite(const Numbers & numbers)
{
  for (const double number : numbers) {
    if (!std::isfinite(number)) { return false; }
  }
  return true;
}

/// The handles of an interface in the order of the axes: all, or none.
template <class Handle>
std::vector<Handle> ordered(
  const std::vector<Handle> & handles, const std::array<Axis, size> & axes, const std::string & interface)
{
  std::vector<Handle> found;
  for (const Axis & axis : axes) {
    for (const Handle & handle : handles) {
      if (handle.get_prefix_name() == axis.name && handle.get_interface_name() == interface) {
        if (!handle) { throw transmission_interface::Exception("a handle of " + axis.name + " that points nowhere"); }
        found.push_back(handle);
      }
    }
  }
  if (!found.empty() && found.size() != size) {
    throw transmission_interface::Exception("@NAME@: not one " + interface + " handle for each joint or actuator");
  }
  return found;
}
}  // namespace

LinkageTransmission::LinkageTransmission(
  const std::array<Axis, size> & joints, const std::array<Axis, size> & actuators)
: joints_(joints),
  actuators_(actuators),
  measured_(@NAME@_motors, {@Q_MOTORS@}, {@Y_MOTORS@}),
  commanded_(@NAME@_joints, {@Q_JOINTS@}, {@Y_JOINTS@})
{
  for (const Axis & axis : actuators_) {
    if (!std::isfinite(axis.reduction) || !(std::fabs(axis.reduction) > 0.0) || !std::isfinite(axis.offset)) {
      throw transmission_interface::Exception(axis.name + ": a reduction of 0, or no number");
    }
  }
  for (const Axis & axis : joints_) {
    if (!(std::fabs(axis.reduction - 1.0) <= 0.0) || !std::isfinite(axis.offset)) {
      throw transmission_interface::Exception(axis.name + ": joints of a linkage have no reduction: state 1");
    }
  }
}

void LinkageTransmission::configure(
  const std::vector<transmission_interface::JointHandle> & joint_handles,
  const std::vector<transmission_interface::ActuatorHandle> & actuator_handles)
{
  joint_.position = ordered(joint_handles, joints_, "position");
  joint_.velocity = ordered(joint_handles, joints_, "velocity");
  joint_.effort = ordered(joint_handles, joints_, "effort");
  actuator_.position = ordered(actuator_handles, actuators_, "position");
  actuator_.velocity = ordered(actuator_handles, actuators_, "velocity");
  actuator_.effort = ordered(actuator_handles, actuators_, "effort");
  told_.clear();
  for (const auto & handle : joint_handles) {
    if (handle.get_interface_name() == "status") { told_.push_back(handle); }
  }
  if (joint_.position.empty() || actuator_.position.empty()) {
    throw transmission_interface::Exception("@NAME@: positions on both sides are needed: the map is of the posture");
  }
  if (joint_.velocity.size() != actuator_.velocity.size() || joint_.effort.size() != actuator_.effort.size()) {
    throw transmission_interface::Exception("@NAME@: velocities, and efforts, are of both sides or of none");
  }
}

void LinkageTransmission::actuator_to_joint()
{
  Numbers position = read(actuator_.position), velocity = read(actuator_.velocity), effort = read(actuator_.effort);
  for (std::size_t k = 0; k < size; k++) {
    position[k] = (position[k] - actuators_[k].offset) / actuators_[k].reduction;
    velocity[k] /= actuators_[k].reduction;
    effort[k] *= actuators_[k].reduction;
  }
  const int found = measured_.find(position);
  if (found != OK) { return tell(found); }
  Numbers across = measured_.across();
  for (std::size_t k = 0; k < size; k++) { across[k] += joints_[k].offset; }
  const Numbers rates = measured_.rates(velocity), efforts = measured_.efforts(effort);
  if (!finite(across) || !finite(rates) || !finite(efforts)) { return tell(NO_NUMBER); }
  write(joint_.position, across);
  write(joint_.velocity, rates);
  write(joint_.effort, efforts);
  tell(OK);
}

void LinkageTransmission::joint_to_actuator()
{
  Numbers position = read(joint_.position);
  const Numbers velocity = read(joint_.velocity), effort = read(joint_.effort);
  for (std::size_t k = 0; k < size; k++) { position[k] -= joints_[k].offset; }
  bool moves = false;  // whether positions are commanded: some controllers leave all of them no numbers
  for (const double number : position) { moves = moves || !std::isnan(number); }
  if (!moves && !measured_.known()) { return tell(NO_NUMBER); }
  const int found = moves ? commanded_.find(position) : OK;
  if (found != OK) { return tell(found); }
  Numbers across = commanded_.across();
  Numbers rates = moves ? commanded_.rates(velocity) : measured_.rates_back(velocity);
  Numbers efforts = measured_.known() ? measured_.efforts_back(effort) : commanded_.efforts(effort);
  for (std::size_t k = 0; k < size; k++) {
    across[k] = across[k] * actuators_[k].reduction + actuators_[k].offset;
    rates[k] *= actuators_[k].reduction;
    efforts[k] /= actuators_[k].reduction;
  }
  if (!finite(across) || !finite(rates) || !finite(efforts)) { return tell(NO_NUMBER); }
  if (moves) { write(actuator_.position, across); }
  write(actuator_.velocity, rates);
  write(actuator_.effort, efforts);
  tell(OK);
}

void LinkageTransmission::tell(int status)
{
  status_ = status;
  missed_ = status == OK ? 0 : missed_ + 1;
  for (auto & handle : told_) { static_cast<void>(handle.set_value(static_cast<double>(status))); }
}
}  // namespace @NAME@
