// Plain numbers from Python: every reader throws std::invalid_argument (a ValueError there) for what it cannot read.
#pragma once
#include "arrays.hpp"
#include "spatial.hpp"

#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <stdexcept>
#include <string>
#include <vector>

namespace ccpin::reading {

inline void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(std::string("specification: ") + what);
}

// f(), with Python's complaints about missing keys and wrong types, and nanobind's, as std::invalid_argument.
template <class F> auto checked(F&& f) {
  try {
    return f();
  } catch (const nb::cast_error&) {
    throw std::invalid_argument("specification: a value has a wrong type");
  } catch (nb::python_error& error) {
    for (PyObject* kind : {PyExc_LookupError, PyExc_TypeError, PyExc_ValueError, PyExc_ArithmeticError})
      if (error.matches(kind)) throw std::invalid_argument(std::string("specification: ") + error.what());
    throw;
  }
}

inline nb::sequence sequence(nb::handle h) { return nb::cast<nb::sequence>(h); }
inline nb::tuple tuple(nb::handle h, size_t size) {
  const nb::tuple t = nb::cast<nb::tuple>(h);
  require(t.size() == size, "a tuple has a wrong length");
  return t;
}
inline double number(nb::handle h) {
  const double x = nb::cast<double>(h);
  require(std::isfinite(x), "a number is not finite");
  return x;
}
inline int integer(nb::handle h) { return nb::cast<int>(h); }
inline std::string text(nb::handle h) { return nb::cast<std::string>(h); }

constexpr size_t kAny = size_t(-1);
inline std::vector<int> integers(nb::handle h, size_t size = kAny) {
  std::vector<int> x = nb::cast<std::vector<int>>(h);
  require(size == kAny || x.size() == size, "a list has a wrong length");
  return x;
}
inline std::vector<double> numbers(nb::handle h, size_t size = kAny) {
  std::vector<double> x = nb::cast<std::vector<double>>(h);
  require(size == kAny || x.size() == size, "a list has a wrong length");
  require(In::finite(x.data(), Py_ssize_t(x.size())), "a number is not finite");
  return x;
}
inline In array(nb::handle h, Py_ssize_t rows, Py_ssize_t columns) {
  In x = nb::cast<In>(h);
  require(x.given() && x.rows == rows && x.size == columns && x.dimensions == (rows == 1 ? 1 : 2),
          "an array has a wrong shape");
  require(In::finite(x.data, rows * columns), "an array is not finite");
  return x;
}
inline Vec3 vec(nb::handle h) { return Eigen::Map<const Vec3>(array(h, 1, 3).data); }
inline Mat3 mat(nb::handle h) {
  const In x = array(h, 3, 3);
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(x.data);
}
inline Pose pose(nb::handle h) {
  const In x = array(h, 4, 4);
  const Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> M(x.data);
  return {M.topLeftCorner<3, 3>(), M.topRightCorner<3, 1>()};
}

// The place of a name in a list of them.
template <size_t N> int place_of(const std::string& name, const char* const (&names)[N], const char* what) {
  for (size_t k = 0; k < N; ++k)
    if (name == names[k]) return int(k);
  throw std::invalid_argument(std::string("the core knows no ") + what + " '" + name + "'");
}

}  // namespace ccpin::reading
