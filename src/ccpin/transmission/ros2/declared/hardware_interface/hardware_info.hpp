// Declared from the documentation of ROS 2 Jazzy's hardware_interface, for builds where it is missing.
#ifndef DECLARED_HARDWARE_INTERFACE_HARDWARE_INFO_HPP
#define DECLARED_HARDWARE_INTERFACE_HARDWARE_INFO_HPP

#include <string>
#include <unordered_map>
#include <vector>

namespace hardware_interface
{
struct JointInfo
{
  std::string name;
  std::vector<std::string> state_interfaces, command_interfaces;
  std::string role;
  double mechanical_reduction = 1.0, offset = 0.0;
};

struct ActuatorInfo
{
  std::string name;
  std::vector<std::string> state_interfaces, command_interfaces;
  std::string role;
  double mechanical_reduction = 1.0, offset = 0.0;
};

struct TransmissionInfo
{
  std::string name, type;
  std::vector<JointInfo> joints;
  std::vector<ActuatorInfo> actuators;
  std::unordered_map<std::string, std::string> parameters;
};
}  // namespace hardware_interface

#endif
