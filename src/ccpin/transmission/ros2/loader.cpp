// What pluginlib loads: the transmission of a <transmission> element of the robot description.
#include <cstdio>
#include <exception>
#include <memory>

#include "@NAME@/linkage_transmission.hpp"
#include "hardware_interface/hardware_info.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "transmission_interface/exception.hpp"
#include "transmission_interface/transmission_loader.hpp"

namespace @NAME@
{
namespace
{
/// The stated axis of each name of the linkage: by its role where it has one, else by its own name.
template <class Stated>
std::array<Axis, size> axes_of(const std::vector<Stated> & stated, const std::array<const char *, size> & names)
{
  std::array<Axis, size> found;
  if (stated.size() != size) { throw transmission_interface::Exception("not as many joints and actuators as it has"); }
  for (std::size_t k = 0; k < size; k++) {
    for (const Stated & one : stated) {
      if ((one.role.empty() ? one.name : one.role) == names[k]) {
        found[k] = Axis{one.name, one.mechanical_reduction, one.offset};
      }
    }
    if (found[k].name.empty()) { throw transmission_interface::Exception(std::string("none is or has the role ") + names[k]); }
  }
  return found;
}
}  // namespace

class LinkageTransmissionLoader : public transmission_interface::TransmissionLoader
{
public:
  /// No transmission, and a line on stderr, where the description does not fit.
  std::shared_ptr<transmission_interface::Transmission> load(
    const hardware_interface::TransmissionInfo & transmission_info) override
  {
    try {
      return std::make_shared<LinkageTransmission>(
        axes_of(transmission_info.joints, joint_names), axes_of(transmission_info.actuators, motor_names));
    } catch (const std::exception & error) {
      std::fprintf(stderr, "transmission '%s': %s\n", transmission_info.name.c_str(), error.what());
      return nullptr;
    }
  }
};
}  // namespace @NAME@

PLUGINLIB_EXPORT_CLASS(@NAME@::LinkageTransmissionLoader, transmission_interface::TransmissionLoader)
