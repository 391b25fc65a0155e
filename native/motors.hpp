// The actuated joints' efforts u of least norm with ρᵀSᵀu = D q̈ + C q̇ + damping q̇ + g − ρᵀJᵀw (22).
//
// T = ρᵀSᵀ has as many rows as q̇ and a column a motor; ρ couples a cluster's own coordinates alone, so T is a block
// diagonal. Where T has full row rank u = Tᵀ(T Tᵀ)⁻¹τ, by way of Tᵀ = Q R (Householder): Rᵀ y = τ, u = Q y. Where it has not,
// or nearly not, only the reference can tell what is left.
#pragma once
#include "reduced_model.hpp"

namespace ccpin {

class Motors {
 public:
  explicit Motors(ReducedModel& model) : r_(model), m_(model.m), tau_(m_.n) {
    size_t rows = 0, columns = 0;
    for (const Cluster& c : m_.clusters) {
      patterns_.push_back(dense(int(c.motors.size()), c.n()));
      rows = std::max(rows, c.motors.size()), columns = std::max<size_t>(columns, c.n());
    }
    A_.resize(rows * columns), pivot_.resize(columns), diagonal_.resize(columns), y_.resize(columns), u_.resize(rows);
  }

  // u, after `sigma` or `at`; false where no u is known to produce that acceleration.
  bool efforts(const double* v, const double* a, double* u, const Pushes& pushes = {}) {
    if (m_.direct) {
      r_.inverse(v, a, u, pushes);
      return true;
    }
    for (const Pattern& p : patterns_)
      if (p.rows < p.n) return false;
    r_.inverse(v, a, tau_.data(), pushes);
    std::fill(u, u + m_.motors, 0.);
    for (size_t k = 0; k < m_.clusters.size(); ++k)
      if (!solve(int(k), u)) return false;
    return true;
  }

 private:
  static constexpr double kDeficient = 1e-7;  // of R's smallest diagonal entry over its largest
  ReducedModel& r_;
  const Mechanism& m_;
  std::vector<Pattern> patterns_;  // by cluster, of Tᵀ: dense
  std::vector<double> A_, diagonal_, y_, u_, tau_;
  std::vector<int> pivot_;

  bool solve(int k, double* u) {
    const Cluster& c = m_.clusters[k];
    const int n = c.n(), motors = int(c.motors.size());
    for (int i = 0; i < motors; ++i)
      for (int l = 0; l < n; ++l) A_[size_t(i) * n + l] = c.gears[i] * r_.states[k].rho[size_t(c.motor_columns[i]) * n + l];
    for (int l = 0; l < n; ++l) y_[l] = tau_[c.independent[l]];
    Factor f{&patterns_[k], A_.data(), pivot_.data(), diagonal_.data(), motors, n};
    f.factorize();
    if (!(f.ratio >= kDeficient)) return false;
    f.solve_transposed(y_.data(), u_.data());
    for (int i = 0; i < motors; ++i) u[c.motors[i]] = u_[i];
    return true;
  }
};

}  // namespace ccpin
