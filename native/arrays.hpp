// NumPy arrays in and out at the price of a pointer (nanobind's own arrays cost 140 ns each way in, 800 out).
#pragma once
#define NPY_NO_DEPRECATED_API NPY_2_0_API_VERSION
#include <nanobind/nanobind.h>
#include <numpy/arrayobject.h>

#include <cmath>
#include <initializer_list>

namespace nb = nanobind;

namespace ccpin {

// A float64 vector or row-major matrix; `rows` is −1 for None and 1 for a vector.
struct In {
  nb::object owner;
  const double* data = nullptr;
  Py_ssize_t rows = -1, middle = 1, size = 0, dimensions = 0;  // a third axis lies between the two

  bool given() const { return rows >= 0; }
  bool is_vector(Py_ssize_t length) const { return dimensions == 1 && size == length && finite(data, length); }
  bool is_matrix(Py_ssize_t width) const { return dimensions == 2 && size == width; }
  static bool finite(const double* x, Py_ssize_t length) {
    for (Py_ssize_t k = 0; k < length; ++k)
      if (!std::isfinite(x[k])) return false;
    return true;
  }
};

// A new array of float64 (or bool), its memory uninitialised.
template <class T = double> nb::object new_array(std::initializer_list<Py_ssize_t> shape, T*& data) {
  npy_intp dims[4];
  int count = 0;
  for (Py_ssize_t d : shape) dims[count++] = d;
  PyObject* array = PyArray_SimpleNew(count, dims, sizeof(T) == 1 ? NPY_BOOL : NPY_DOUBLE);
  if (!array) throw nb::python_error();
  data = static_cast<T*>(PyArray_DATA(reinterpret_cast<PyArrayObject*>(array)));
  return nb::steal(array);
}

}  // namespace ccpin

namespace nanobind::detail {
template <> struct type_caster<ccpin::In> {
  NB_TYPE_CASTER(ccpin::In, const_name("numpy.typing.ArrayLike | None"))
  bool from_python(handle src, uint32_t, cleanup_list*) noexcept {
    PyObject* o = src.ptr();
    if (o == Py_None) return true;
    if (!(PyArray_CheckExact(o) && PyArray_TYPE((PyArrayObject*)o) == NPY_DOUBLE &&
          PyArray_ISCARRAY_RO((PyArrayObject*)o))) {
      o = PyArray_FROM_OTF(o, NPY_DOUBLE, NPY_ARRAY_IN_ARRAY);
      if (!o) {
        PyErr_Clear();
        value.rows = 0;  // not an array of numbers: no shape fits it, so the kernel declines
        return true;
      }
      value.owner = steal(o);
    }
    auto* a = reinterpret_cast<PyArrayObject*>(o);
    value.dimensions = PyArray_NDIM(a);
    if (value.dimensions < 1 || value.dimensions > 3) {
      value.dimensions = 0, value.rows = 0;
      return true;
    }
    value.data = static_cast<const double*>(PyArray_DATA(a));
    value.rows = value.dimensions >= 2 ? PyArray_DIM(a, 0) : 1;
    if (value.dimensions == 3) value.middle = PyArray_DIM(a, 1);
    value.size = PyArray_DIM(a, int(value.dimensions) - 1);
    return true;
  }
};
}  // namespace nanobind::detail
