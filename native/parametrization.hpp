// q′ = σ(q) (12), ρ (14), ρ̇ (35) and ρ̇ q̇, cluster by cluster; the trust test is that of ccpin.kinematics.parametrization.
//
// Clusters share no row and no column of ψ, so each is solved alone: a step that one cluster does not trust shortens the
// way of that cluster only, and the branch reached is the same.
#pragma once
#include "constraints.hpp"

namespace ccpin {

constexpr double kContraction = 0.125, kLargestMove = 1.0, kShortestStep = 0x1p-30, kOpenStart = 1e-6;
constexpr int kMaxNewton = 12;
// Below this reciprocal condition number nothing is answered: the reference, whose limit is 1e-10, decides and explains.
// It is computed only where pivots or ρ say that it could matter.
constexpr double kSingular = 1e-9, kSuspiciousPivots = 1e-6, kSuspiciousRho = 1e5;

// A closed point, as a start: its ρ spares Newton the first evaluation.
struct ClosedPoint {
  std::vector<double> q_free;
  std::vector<std::vector<double>> rho;  // by cluster
  std::vector<int> sign;
};

class Parametrization : public Constraints {
 public:
  explicit Parametrization(const Mechanism& mechanism) : Constraints(mechanism) {
    q_start_.resize(m.n_q), q_ahead_.resize(m.n_q), line_.resize(m.n), here_.resize(m.nq);
  }

  // σ(q) from a start; false where the trusted path does not lead there.
  bool sigma(const double* q, const double* start) {
    for (size_t k = 0; k < m.clusters.size(); ++k)
      if (!solve(m.clusters[k], states[k], q, start, nullptr, 0)) return false;
    return true;
  }
  bool sigma(const double* q, const ClosedPoint& near) {
    for (size_t k = 0; k < m.clusters.size(); ++k)
      if (!solve(m.clusters[k], states[k], q, near.q_free.data(), near.rho[k].data(), near.sign[k])) return false;
    return true;
  }
  void remember(ClosedPoint& point) const {
    point.q_free = q_free;
    point.rho.resize(states.size()), point.sign.resize(states.size());
    for (size_t k = 0; k < states.size(); ++k) point.rho[k] = states[k].rho, point.sign[k] = states[k].factor.sign;
  }

  // ρ at a configuration that is closed already; false where it is singular.
  bool at(const double* q_closed) {
    std::copy(q_closed, q_closed + m.nq, q_free.begin());
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      linearize(m.clusters[k], states[k], nullptr);
      if (!finish(m.clusters[k], states[k])) return false;
    }
    return true;
  }

  // q = α(q′).
  void alpha(const double* configuration, double* q) const {
    for (const Coordinate& k : m.coordinates) {
      const double* x = configuration + m.joints[k.joint].q;
      if (k.whole()) std::copy(x, x + k.nq, q + k.q);
      else q[k.q] = component(k, x);
    }
  }

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
    double* change = s.right.data();
    int row = 0;
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      const Moving a = travel(loop.path_a, v), b = travel(loop.path_b, v);
      loop_row_rates(loop, ends(loop), a.V, b.V, &s.row_rates[row]);
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
    for (int k = 0; k < c.unknowns(); ++k) s.bias[c.dependent[k]] = change[k];
  }

  // ψ̇_q′ along q̇′ = v, entry by entry: f(row, local column, rate). After `bias` with the same v.
  template <class F> void jacobian_rate(const Cluster& c, const ClusterState& s, const double* v, F&& f) const {
    int row = 0;
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      for (int side = 0; side < 2; ++side) {
        Motion V;
        for (int j : side ? loop.path_b : loop.path_a) {
          V += own(j, v);
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
  static void scatter(const Cluster& c, const double* solution, int n, double* out) {
    for (int k = 0; k < c.unknowns(); ++k)
      std::copy(solution + size_t(k) * n, solution + size_t(k + 1) * n, out + size_t(c.dependent[k]) * n);
  }

 private:
  std::vector<double> q_start_, q_ahead_, line_, here_, inverse_;

  template <class F> double component_rate(const Coordinate& k, const double* v, F&& f) const {
    const Joint& joint = m.joints[k.joint];
    const int first = m.column_of[joint.v];
    double row[6], rate[6], sum = 0;
    component_row(k, &q_free[joint.q], v + first, row, rate);
    for (int i = 0; i < joint.nv; ++i) sum += rate[i] * v[first + i], f(first + i, rate[i]);
    return sum;
  }

  bool solve(const Cluster& c, ClusterState& s, const double* q, const double* start, const double* rho, int sign) {
    bool open = false;
    if (newton(c, s, q, start, rho, sign, open)) return true;
    if (rho) return walk(c, s, q, start);
    if (open && !close_start(c, s, start)) return false;
    return walk(c, s, q, open ? here_.data() : start);
  }

  // One trusted Newton solve on ψ̄ (11): its second correction is at most an eighth of the first, no step is longer than
  // one, and det ψ_q′ keeps its sign. Where ρ at a closed start is known, the first step is ρ Δq.
  bool newton(const Cluster& c, ClusterState& s, const double* q, const double* start, const double* rho, int sign,
              bool& open) {
    copy_cluster(c, start, q_free.data());
    int first = 0;
    double last = 0;
    if (rho && c.n()) {
      last = tangent_step(c, s, q, rho);
      if (!(last <= kLargestMove)) return false;
      move(c, s.step.data());
      first = 1;
    }
    for (int iteration = first; iteration < kMaxNewton; ++iteration) {
      const double size = linearize(c, s, q);
      if (iteration == 0) {
        sign = s.factor.sign;
        for (int r = 0; r < c.phi_rows(); ++r) open |= std::abs(s.residual[r]) > kOpenStart;
      }
      if (too_singular(c, s)) return false;
      if (size <= m.tolerance || (iteration && last <= 1e-9 && size <= 100 * m.tolerance))
        return s.factor.sign == sign && finish(c, s);
      const double length = newton_step(c, s);
      if (!(length <= kLargestMove)) return false;
      if (iteration && length > kContraction * last && length > 1e-9) return false;
      last = length;
      move(c, s.step.data());
    }
    return false;
  }

  double tangent_step(const Cluster& c, ClusterState& s, const double* q, const double* rho) {
    const int n = c.n();
    whole_gaps(c, q, s.right.data());
    int at = int(c.direct.size());
    for (int i : c.components) s.right[at++] = component_gap(m.coordinates[i], q);
    double length = 0;
    for (int col = 0; col < c.width(); ++col) {
      double sum = 0;
      for (int i = 0; i < n; ++i) sum += rho[size_t(col) * n + i] * s.right[i];
      s.step[col] = sum, length += sum * sum;
    }
    return std::sqrt(length);
  }

  double newton_step(const Cluster& c, ClusterState& s) const {
    double* right = s.right.data();
    for (int r = 0; r < c.rows(); ++r) {
      double sum = s.residual[r];
      for (size_t k = 0; k < c.direct.size(); ++k) sum -= s.J[size_t(r) * c.width() + c.direct[k]] * s.gap[k];
      right[r] = sum;
    }
    s.factor.solve(right, 1);
    scatter(c, right, 1, s.step.data());
    for (size_t k = 0; k < c.direct.size(); ++k) s.step[c.direct[k]] = s.gap[k];
    double length = 0;
    for (double x : s.step) length += x * x;
    return std::sqrt(length);
  }

  void move(const Cluster& c, const double* step) {
    for (int j : c.joints) retract(m.joints[j].kind, &q_free[m.joints[j].q], step + m.column_of[m.joints[j].v]);
  }

  // Along the straight line from α(start) to q, in steps that Newton trusts.
  bool walk(const Cluster& c, ClusterState& s, const double* q, const double* start) {
    alpha(start, q_start_.data());
    for (int i : c.coordinates) {
      const Coordinate& k = m.coordinates[i];
      coordinate_difference(k, &q_start_[k.q], q + k.q, &line_[k.v]);
    }
    copy_cluster(c, start, here_.data());
    double done = 0, stride = 0.5;
    bool open;
    while (stride >= kShortestStep) {
      const double ahead = std::min(1.0, done + stride);
      for (int i : c.coordinates) target(m.coordinates[i], q, ahead);
      if (!newton(c, s, q_ahead_.data(), here_.data(), nullptr, 0, open)) {
        stride *= 0.5;
        continue;
      }
      if (ahead == 1) return true;
      copy_cluster(c, q_free.data(), here_.data());
      done = ahead, stride *= 2;
    }
    return false;
  }
  void target(const Coordinate& k, const double* q, double ahead) {
    const double* from = ahead == 1 ? q : q_start_.data();
    std::copy(from + k.q, from + k.q + k.nq, &q_ahead_[k.q]);
    if (ahead == 1) return;
    double step[6];
    for (int i = 0; i < k.nv; ++i) step[i] = ahead * line_[k.v + i];
    coordinate_retract(k, &q_ahead_[k.q], step);
  }

  // Closes an open guess at its own q, into `here_`; false where it is too far open.
  bool close_start(const Cluster& c, ClusterState& s, const double* start) {
    alpha(start, q_start_.data());
    copy_cluster(c, start, q_free.data());
    for (int iteration = 0; iteration < kMaxNewton; ++iteration) {
      if (linearize(c, s, q_start_.data()) <= m.tolerance) {
        copy_cluster(c, q_free.data(), here_.data());
        return true;
      }
      if (too_singular(c, s) || !(newton_step(c, s) <= kLargestMove)) return false;
      move(c, s.step.data());
    }
    return false;
  }

  // ρ of one cluster; false where ψ_q′ is too near singular to answer.
  bool finish(const Cluster& c, ClusterState& s) {
    if (!(s.factor.ratio > 0)) return false;
    solve_rho(c, s);
    double largest = 0;
    for (double x : s.rho) largest = std::max(largest, std::abs(x));
    return (s.factor.ratio >= kSuspiciousPivots && largest <= kSuspiciousRho) || cluster_rcond(c, s) >= kSingular;
  }
  bool too_singular(const Cluster& c, ClusterState& s) {
    if (s.factor.ratio >= kSuspiciousPivots) return false;
    if (!(s.factor.ratio > 0)) return true;
    solve_rho(c, s);
    return !(cluster_rcond(c, s) >= kSingular);
  }

  void solve_rho(const Cluster& c, ClusterState& s) const {
    const int n = c.n(), direct = int(c.direct.size());
    double* right = s.right.data();
    for (int r = 0; r < c.rows(); ++r) {
      for (int k = 0; k < direct; ++k) right[size_t(r) * n + k] = -s.J[size_t(r) * c.width() + c.direct[k]];
      for (int k = direct; k < n; ++k) right[size_t(r) * n + k] = r == c.phi_rows() + k - direct ? 1. : 0.;
    }
    s.factor.solve(right, n);
    scatter(c, right, n, s.rho.data());
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
    for (int k : c.dependent) psi = std::max(psi, column(&s.J[k], c.rows(), c.width()));
    for (size_t k = 0; k < c.direct.size(); ++k) {
      psi = std::max(psi, 1 + column(&s.J[c.direct[k]], c.rows(), c.width()));
      inverse = std::max(inverse, column(&s.rho[k], c.width(), c.n()));
    }
    const int rows = c.rows();
    inverse_.assign(size_t(rows) * rows, 0.);
    for (int k = 0; k < rows; ++k) inverse_[size_t(k) * rows + k] = 1;
    if (rows) s.factor.solve(inverse_.data(), rows);
    for (int k = 0; k < rows; ++k) inverse = std::max(inverse, column(&inverse_[k], c.unknowns(), rows));
    return {std::max(psi, 1e-300), std::max(inverse, 1e-300)};
  }
};

}  // namespace ccpin
