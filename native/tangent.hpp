// The tangent of the closed configurations: ρ (14), ρ̇ (35), ρ̇ q̇, and how near to singular ψ_q′ is, cluster by cluster.
#pragma once
#include "constraints.hpp"

namespace ccpin {

// Below this reciprocal condition number nothing is answered: the reference, whose limit is 1e-10, decides and explains.
// It is computed only where pivots or ρ say that it could matter.
constexpr double kSingular = 1e-9, kSuspiciousPivots = 1e-6, kSuspiciousRho = 1e5;
constexpr double kTurn = 0.5;      // of ψ_q′⁻¹ B: the most that a trusted step changes of it,
constexpr double kRounded = 2;     // and of its square times the tolerance of closed points: the most it may be,
constexpr double kFarFromSingular = 2e-7;  // and where estimates are relied on

class Tangent : public Constraints {
 public:
  using Constraints::Constraints;

  // Reciprocal condition number of ψ_q′ in the 1-norm, after `sigma` or `at`: ψ_q′ is a permuted block diagonal of the
  // clusters' [[A, B], [0, I]], whose inverse [[A⁻¹, −A⁻¹B], [0, I]] has ρ in it.
  double rcond() {
    double norm = 0, inverse = 0;
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Norms here = norms(m.clusters[k], states[k]);
      norm = std::max(norm, here.psi), inverse = std::max(inverse, here.inverse);
    }
    return 1 / (norm * inverse);
  }

  // Whether pivots or ρ say that ψ_q′ may be badly conditioned: only then is `rcond` worth its price.
  bool suspicious() const {
    for (const ClusterState& s : states) {
      if (s.factor.ratio < 1e-3) return true;
      for (double x : s.rho)
        if (!(std::abs(x) < 1e3)) return true;
    }
    return false;
  }
  // |φ| of the last linearisation.
  double closure() const {
    double sum = 0;
    for (size_t k = 0; k < states.size(); ++k)
      for (int r = 0; r < m.clusters[k].phi_rows(); ++r) sum += states[k].residual[r] * states[k].residual[r];
    return std::sqrt(sum);
  }

  // γ = ρ̇ q̇ = −ψ_q′⁻¹ ψ̇_q′ q̇′ over one cluster's columns, for q̇′ = v.
  void bias(const Cluster& c, ClusterState& s, const double* v) {
    travel(c, v);
    if (!c.rows()) return;
    double* change = s.right.data();
    int row = 0;
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      const Moving a = along(loop, loop.a), b = along(loop, loop.b);
      loop_row_rates(loop, ends(loop), a.V, b.V, s.row_rates.data() + row);
      for (const int end = row + loop.size; row < end; ++row) {
        const Row &W = s.rows[row], &dW = s.row_rates[row];
        change[row] = -(dot(dW.a, a.V) + dot(W.a, a.A) + dot(dW.b, b.V) + dot(W.b, b.A));
      }
    }
    for (int i : c.couplings) {
      double sum = 0;
      for (const CouplingTerm& t : m.couplings[i].terms) {
        const double speed = v[m.column_of[t.v]];
        sum += slope(t, q_free.data(), 2) * speed * speed;
      }
      change[row++] = -sum;
    }
    for (int i : c.components) change[row++] = -component_rate(m.coordinates[i], v, [](int, double) {});
    s.factor.solve(change, 1);
    std::fill(s.bias.begin(), s.bias.end(), 0.);
    for (int k = 0; k < c.unknowns(); ++k) s.bias[c.dependent[k]] = change[c.pattern.slots[k]];
  }

  // ψ̇_q′ along q̇′ = v, entry by entry: f(row, local column, rate). After `bias` with the same v.
  template <class F> void jacobian_rate(const Cluster& c, const ClusterState& s, const double* v, F&& f) const {
    int row = 0;
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      for (int side = 0; side < 2; ++side) {
        for (int j : side ? loop.path_b : loop.path_a) {
          const Motion V = along(loop, j).V;
          for (int k = m.joints[j].v; k < m.joints[j].v + m.joints[j].nv; ++k) {
            const Motion change = cross(V, S[k]);
            for (int r = row; r < row + loop.size; ++r)
              f(r, m.column_of[k], side ? dot(s.row_rates[r].b, S[k]) + dot(s.rows[r].b, change)
                                        : dot(s.row_rates[r].a, S[k]) + dot(s.rows[r].a, change));
          }
        }
      }
      row += loop.size;
    }
    for (int i : c.couplings) {
      for (const CouplingTerm& t : m.couplings[i].terms)
        f(row, m.column_of[t.v], slope(t, q_free.data(), 2) * v[m.column_of[t.v]]);
      ++row;
    }
    for (int i : c.components) {
      component_rate(m.coordinates[i], v, [&](int col, double rate) { f(row, col, rate); });
      ++row;
    }
  }

  // φ̇_q′ (m × n′, row-major) along q̇′, at any configuration.
  void rate(const double* q, const double* v_free, double* out) {
    closed_ = false;
    std::copy(q, q + m.nq, q_free.begin());
    std::fill(out, out + size_t(m.m) * m.nv, 0.);
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      ClusterState& s = states[k];
      linearize(c, s, nullptr);
      std::vector<double> v(c.width());
      for (int col = 0; col < c.width(); ++col) v[col] = v_free[c.columns[col]];
      bias(c, s, v.data());
      std::vector<int> global;
      for (int i : c.loops)
        for (int r = 0; r < m.loops[i].size; ++r) global.push_back(m.loops[i].row + r);
      for (int i : c.couplings) global.push_back(m.couplings[i].row);
      jacobian_rate(c, s, v.data(), [&](int row, int col, double rate) {
        if (row < c.phi_rows()) out[size_t(global[row]) * m.nv + c.columns[col]] += rate;
      });
    }
  }

  // ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ over one cluster, width × n. After `bias` with the same v.
  void rho_dot(const Cluster& c, ClusterState& s, const double* v, double* out) {
    const int n = c.n();
    double* right = s.right.data();
    std::fill(right, right + size_t(c.rows()) * n, 0.);
    jacobian_rate(c, s, v, [&](int row, int col, double rate) {
      for (int i = 0; i < n; ++i) right[size_t(row) * n + i] -= rate * s.rho[size_t(col) * n + i];
    });
    s.factor.solve(right, n);
    std::fill(out, out + size_t(c.width()) * n, 0.);
    scatter(c, right, n, out);
  }

  // Rows of a solution to the dependent columns of a width × n matrix.
  static void scatter(const Cluster& c, const double* solution, int n, double* out) { scatter(c, solution, n, n, out); }
  static void scatter(const Cluster& c, const double* solution, int stride, int n, double* out) {
    for (int k = 0; k < c.unknowns(); ++k) {
      const double* from = solution + size_t(c.pattern.slots[k]) * stride;
      double* to = out + size_t(c.dependent[k]) * n;
      for (int i = 0; i < n; ++i) to[i] = from[i];
    }
  }

 protected:
  // ρ of one cluster, and its probe where asked; false where ψ_q′ is too near singular to answer.
  bool finish(const Cluster& c, ClusterState& s, bool probing = false) {
    if (!(s.factor.ratio > 0)) return false;
    solve_rho(c, s, probing);
    double largest = 0;
    for (double x : s.rho) largest = std::max(largest, std::abs(x));
    return (s.factor.ratio >= kSuspiciousPivots && largest <= kSuspiciousRho) || cluster_rcond(c, s) >= kSingular;
  }
  // ψ_q′⁻¹ B for a B of two columns without structure is solved beside other right sides: of the `stride` numbers in each
  // row of s.right the last two are B's. Returns the largest entry, and so how large ψ_q′⁻¹ is.
  double solve_beside_probe(const Cluster& c, ClusterState& s, int stride) const {
    double* right = s.right.data() + stride - 2;
    for (int r = 0; r < c.rows(); ++r, right += stride) right[0] = c.unstructured[2 * r], right[1] = c.unstructured[2 * r + 1];
    s.factor.solve(s.right.data(), stride);
    double largest = 0;
    for (int i = 0; i < c.unknowns(); ++i)
      for (int k = 0; k < 2; ++k) {
        s.probe[2 * i + k] = s.right[size_t(stride) * c.pattern.slots[i] + stride - 2 + k];
        largest = std::max(largest, std::abs(s.probe[2 * i + k]));
      }
    return largest;
  }
  // How much ψ_q′⁻¹ B has changed since the start, and the square of its size times the rounding of closed points: whether
  // ψ_q′ was regular on the way here, and rounding decides at neither end.
  struct Turn {
    double change, rounded;
    bool trusted() const { return change <= kTurn && rounded <= kRounded; }
    bool near_singular() const { return !(rounded <= kFarFromSingular); }
  };
  Turn turn_since(const std::vector<double>& before, const ClusterState& s) const {
    double change = 0, size = 0, here = 0;
    for (size_t k = 0; k < before.size(); ++k) {
      const double d = s.probe[k] - before[k];
      change += d * d, size += before[k] * before[k], here += s.probe[k] * s.probe[k];
    }
    return {change > 0 ? std::sqrt(change / size) : 0, std::max(size, here) * m.tolerance};
  }
  bool too_singular(const Cluster& c, ClusterState& s) {
    if (s.factor.ratio >= kSuspiciousPivots) return false;
    if (!(s.factor.ratio > 0)) return true;
    solve_rho(c, s, false);
    return !(cluster_rcond(c, s) >= kSingular);
  }

 private:
  std::vector<double> inverse_;

  template <class F> double component_rate(const Coordinate& k, const double* v, F&& f) const {
    const Joint& joint = m.joints[k.joint];
    const int first = m.column_of[joint.v];
    double row[6], rate[6], sum = 0;
    component_row(k, q_free.data() + joint.q, v + first, row, rate);
    for (int i = 0; i < joint.nv; ++i) sum += rate[i] * v[first + i], f(first + i, rate[i]);
    return sum;
  }

  void solve_rho(const Cluster& c, ClusterState& s, bool probing) const {
    const int n = c.n(), direct = int(c.direct.size()), stride = probing ? n + 2 : n;
    double* right = s.right.data();
    const double* J = s.J.data() + c.unknowns();
    for (int r = 0; r < c.rows(); ++r, J += c.width(), right += stride) {
      for (int k = 0; k < direct; ++k) right[k] = -J[k];
      for (int k = direct; k < n; ++k) right[k] = r == c.phi_rows() + k - direct ? 1. : 0.;
    }
    right = s.right.data();
    if (probing) solve_beside_probe(c, s, stride);
    else s.factor.solve(right, n);
    scatter(c, right, stride, n, s.rho.data());
  }

  struct Norms { double psi, inverse; };
  double cluster_rcond(const Cluster& c, const ClusterState& s) {
    const Norms here = norms(c, s);
    return 1 / (here.psi * here.inverse);
  }
  Norms norms(const Cluster& c, const ClusterState& s) {
    double psi = 0, inverse = 0;
    const auto column = [](const double* x, int count, int stride) {
      double sum = 0;
      for (int k = 0; k < count; ++k) sum += std::abs(x[size_t(k) * stride]);
      return sum;
    };
    for (int k = 0; k < c.unknowns(); ++k) psi = std::max(psi, column(s.J.data() + k, c.rows(), c.width()));
    for (size_t k = 0; k < c.direct.size(); ++k) {
      psi = std::max(psi, 1 + column(s.J.data() + c.unknowns() + k, c.rows(), c.width()));
      inverse = std::max(inverse, column(s.rho.data() + k, c.width(), c.n()));
    }
    const int rows = c.rows();
    inverse_.assign(size_t(rows) * rows, 0.);
    for (int k = 0; k < rows; ++k) inverse_[size_t(k) * rows + k] = 1;
    if (rows) s.factor.solve(inverse_.data(), rows);
    for (int k = 0; k < rows; ++k) {
      double sum = 0;
      for (int slot : c.pattern.slots) sum += std::abs(inverse_[size_t(slot) * rows + k]);
      inverse = std::max(inverse, sum);
    }
    return {std::max(psi, 1e-300), std::max(inverse, 1e-300)};
  }
};

}  // namespace ccpin
