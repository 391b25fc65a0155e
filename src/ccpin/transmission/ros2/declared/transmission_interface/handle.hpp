// Declared from the documentation of ROS 2 Jazzy's transmission_interface, for builds where it is missing.
#ifndef DECLARED_TRANSMISSION_INTERFACE_HANDLE_HPP
#define DECLARED_TRANSMISSION_INTERFACE_HANDLE_HPP

#include <string>

namespace transmission_interface
{
/// A number of a joint or an actuator, owned by whoever made the handle.
class DeclaredHandle
{
public:
  DeclaredHandle(const std::string & prefix, const std::string & interface, double * number)
  : prefix_(prefix), interface_(interface), number_(number)
  {
  }
  virtual ~DeclaredHandle() = default;
  DeclaredHandle(const DeclaredHandle &) = default;
  DeclaredHandle & operator=(const DeclaredHandle &) = default;

  operator bool() const { return number_ != nullptr; }
  std::string get_name() const { return prefix_ + "/" + interface_; }
  const std::string & get_prefix_name() const { return prefix_; }
  const std::string & get_interface_name() const { return interface_; }
  double get_value() const { return *number_; }
  [[nodiscard]] bool set_value(double number)
  {
    *number_ = number;
    return true;
  }

private:
  std::string prefix_, interface_;
  double * number_;
};

class ActuatorHandle : public DeclaredHandle
{
public:
  using DeclaredHandle::DeclaredHandle;
};

class JointHandle : public DeclaredHandle
{
public:
  using DeclaredHandle::DeclaredHandle;
};
}  // namespace transmission_interface

#endif
