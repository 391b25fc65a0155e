// Declared from the documentation of ROS 2 Jazzy's pluginlib, for builds where it is missing: nothing is registered.
#ifndef DECLARED_PLUGINLIB_CLASS_LIST_MACROS_HPP
#define DECLARED_PLUGINLIB_CLASS_LIST_MACROS_HPP

#include <type_traits>

#define PLUGINLIB_EXPORT_CLASS(Class, Base) static_assert(std::is_base_of<Base, Class>::value, "no such plugin");

#endif
