// Declared from the documentation of ROS 2 Jazzy's transmission_interface, for builds where it is missing.
#ifndef DECLARED_TRANSMISSION_INTERFACE_EXCEPTION_HPP
#define DECLARED_TRANSMISSION_INTERFACE_EXCEPTION_HPP

#include <exception>
#include <string>

namespace transmission_interface
{
class Exception : public std::exception
{
public:
  explicit Exception(const std::string & words) : words_(words) {}
  const char * what() const noexcept override { return words_.c_str(); }

private:
  std::string words_;
};
}  // namespace transmission_interface

#endif
