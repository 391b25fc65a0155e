// Rows of a batch shared among threads: each row alone, so results depend on neither their order nor the threads.
#pragma once
#include "arrays.hpp"
#include "workspace.hpp"

#include <atomic>
#include <thread>

namespace ccpin {

// Calls f(workspace, row) for every row; the caller's thread works too, and looks for Ctrl-C between chunks.
template <class F> void for_each_row(Pool& pool, Py_ssize_t rows, int threads, F&& f) {
  constexpr Py_ssize_t chunk = 128;
  std::atomic<Py_ssize_t> next{0};
  std::atomic<bool> stop{false};
  bool interrupted = false;
  const auto work = [&](bool main) {
    Pool::Lease space(pool);
    for (Py_ssize_t from; !stop && (from = next.fetch_add(chunk)) < rows;) {
      for (Py_ssize_t k = from; k < std::min(rows, from + chunk); ++k) f(*space, k);
      if (!main) continue;
      nb::gil_scoped_acquire acquire;
      if (PyErr_CheckSignals() != 0) interrupted = stop = true;
    }
  };
  {
    nb::gil_scoped_release release;
    std::vector<std::thread> others;
    for (int t = 1; t < std::min<Py_ssize_t>(threads, (rows + chunk - 1) / chunk); ++t) others.emplace_back(work, false);
    work(true);
    for (std::thread& t : others) t.join();
  }
  if (interrupted) throw nb::python_error();
}

}  // namespace ccpin
