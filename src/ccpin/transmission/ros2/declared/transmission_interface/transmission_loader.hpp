// Declared from the documentation of ROS 2 Jazzy's transmission_interface, for builds where it is missing.
#ifndef DECLARED_TRANSMISSION_INTERFACE_TRANSMISSION_LOADER_HPP
#define DECLARED_TRANSMISSION_INTERFACE_TRANSMISSION_LOADER_HPP

#include <memory>

#include "hardware_interface/hardware_info.hpp"
#include "transmission_interface/transmission.hpp"

namespace transmission_interface
{
class TransmissionLoader
{
public:
  virtual ~TransmissionLoader() = default;
  virtual std::shared_ptr<Transmission> load(const hardware_interface::TransmissionInfo & stated) = 0;
};
}  // namespace transmission_interface

#endif
