// The faces that cells of an atlas share with leaves (`contacts_of` of `covering/faces.py`), all in whole numbers.
#pragma once
#include "arrays.hpp"

#include <algorithm>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace ccpin::certificates {

// A new or a read-only array of whole numbers, row-major.
class Integers {
 public:
  explicit Integers(nb::handle h) : owner_(nb::steal(PyArray_FROM_OTF(h.ptr(), NPY_INT64, NPY_ARRAY_IN_ARRAY))) {
    if (!owner_.is_valid()) throw nb::python_error();
  }
  explicit Integers(const std::vector<int64_t>& values) {
    npy_intp size = npy_intp(values.size());
    owner_ = nb::steal(PyArray_SimpleNew(1, &size, NPY_INT64));
    if (!owner_.is_valid()) throw nb::python_error();
    std::copy(values.begin(), values.end(), static_cast<int64_t*>(PyArray_DATA(array())));
  }
  const int64_t* data() const { return static_cast<const int64_t*>(PyArray_DATA(array())); }
  Py_ssize_t size() const { return PyArray_SIZE(array()); }
  const nb::object& object() const { return owner_; }

 private:
  nb::object owner_;
  PyArrayObject* array() const { return reinterpret_cast<PyArrayObject*>(owner_.ptr()); }
};

class Contacts {
 public:
  // The fields of `Cells` (N, n), (N, n), (N,), (N,); the cells asked for; which coordinates close on themselves.
  Contacts(nb::handle lower, nb::handle size, nb::handle cut, nb::handle child, nb::handle cells,
           std::vector<bool> wrapped)
      : lower_(lower), size_(size), cut_(cut), child_(child), cells_(cells), wrapped_(wrapped), n_(wrapped.size()) {
    if (lower_.size() != child_.size() * n_ || size_.size() != lower_.size() || cut_.size() != child_.size())
      throw std::invalid_argument("the arrays of the cells do not fit each other");
    check();
    low_.resize(n_), high_.resize(n_);
  }

  // (cell, leaf, at_cell, at_leaf, area, upper), face by face, in the order of the cells and then of the leaves.
  nb::object find() {
    {
      nb::gil_scoped_release release;
      for (Py_ssize_t k = 0; k < n_; ++k)
        for (const bool upper : {false, true})
          for (Py_ssize_t i = 0; i < cells_.size(); ++i) across(cells_.data()[i], k, upper);
    }
    const Py_ssize_t count = Py_ssize_t(cell_.size());
    double *at_cell, *at_leaf, *area;
    bool* upper;
    const nb::object a = new_array({count, n_}, at_cell), b = new_array({count, n_}, at_leaf);
    const nb::object c = new_array({count}, area), d = new_array({count}, upper);
    std::copy(at_cell_.begin(), at_cell_.end(), at_cell), std::copy(at_leaf_.begin(), at_leaf_.end(), at_leaf);
    std::copy(area_.begin(), area_.end(), area), std::copy(upper_.begin(), upper_.end(), upper);
    return nb::make_tuple(Integers(cell_).object(), Integers(leaf_).object(), a, b, c, d);
  }

 private:
  static constexpr int64_t kWhole = int64_t(1) << 32;
  const Integers lower_, size_, cut_, child_, cells_;
  const std::vector<bool> wrapped_;
  const Py_ssize_t n_;
  std::vector<int64_t> low_, high_, cell_, leaf_, open_, found_;
  std::vector<double> at_cell_, at_leaf_, area_;
  std::vector<char> upper_;

  // Whatever points somewhere points at a cell or a coordinate, and every cell's children come after it.
  void check() const {
    const int64_t count = child_.size();
    bool good = true;
    for (int64_t k = 0; k < count; ++k) {
      const int64_t child = child_.data()[k], cut = cut_.data()[k];
      good = good && (child < 0 || (child > k && child + 1 < count && cut >= 0 && cut < n_));
    }
    for (Py_ssize_t k = 0; k < cells_.size(); ++k) good = good && cells_.data()[k] >= 0 && cells_.data()[k] < count;
    for (Py_ssize_t k = 0; k < lower_.size(); ++k)
      for (const int64_t x : {lower_.data()[k], size_.data()[k]}) good = good && x >= 0 && x <= kWhole;
    if (!good) throw std::invalid_argument("the cells are no tree");
  }

  // Contacts across a cell's lower or upper face perpendicular to coordinate k.
  void across(int64_t cell, Py_ssize_t k, bool upper) {
    const int64_t *lower = lower_.data() + cell * n_, *size = size_.data() + cell * n_;
    const int64_t face = upper ? lower[k] + size[k] : lower[k];
    int64_t beyond = upper ? face : face - 1;
    if (wrapped_[k]) beyond = (beyond + kWhole) % kWhole;
    if (beyond < 0 || beyond >= kWhole) return;
    for (Py_ssize_t j = 0; j < n_; ++j) low_[j] = lower[j], high_[j] = lower[j] + size[j];
    low_[k] = beyond, high_[k] = beyond + 1;
    find_leaves();
    for (const int64_t leaf : found_) add(cell, leaf, k, upper, face);
  }

  void add(int64_t cell, int64_t leaf, Py_ssize_t k, bool upper, int64_t face) {
    const int64_t *lower = lower_.data() + leaf * n_, *size = size_.data() + leaf * n_;
    double area = 1;
    for (Py_ssize_t j = 0; j < n_; ++j) {
      if (j == k) {
        at_cell_.push_back(double(face)), at_leaf_.push_back(double(lower[k] + (upper ? 0 : size[k])));
        continue;
      }
      const int64_t start = std::max(low_[j], lower[j]), end = std::min(high_[j], lower[j] + size[j]);
      const double middle = 0.5 * double(start + end);
      at_cell_.push_back(middle), at_leaf_.push_back(middle), area *= double(end - start) / double(kWhole);
    }
    cell_.push_back(cell), leaf_.push_back(leaf), area_.push_back(area), upper_.push_back(upper);
  }

  // The leaves that meet [low, high) in their interiors, by number.
  void find_leaves() {
    found_.clear(), open_.assign(1, 0);
    while (!open_.empty()) {
      const int64_t node = open_.back(), child = child_.data()[node], cut = cut_.data()[node];
      open_.pop_back();
      if (child < 0) {
        found_.push_back(node);
        continue;
      }
      const int64_t border = lower_.data()[(child + 1) * n_ + cut];
      if (low_[cut] < border) open_.push_back(child);
      if (high_[cut] > border) open_.push_back(child + 1);
    }
    std::sort(found_.begin(), found_.end());
  }
};

}  // namespace ccpin::certificates
