// q′ = σ(q) (12), cluster by cluster; its steps are proven as in ccpin.kinematics.parametrization.
//
// Clusters share no row and no column of ψ, so each is solved alone: a step that is not proven for one cluster shortens the
// way of that cluster only, and the branch reached is the same.
#pragma once
#include "branches.hpp"

namespace ccpin {

constexpr double kContraction = 0.125, kChord = 0.0625, kNoise = 1e-9;
constexpr double kShortestStep = 0x1p-30, kOpenStart = 1e-6;
constexpr int kMaxNewton = 16, kMaxClosing = 100, kMaxWalking = 1000;

// A closed point, as a start: its ρ spares Newton the first evaluation.
struct ClosedPoint {
  std::vector<double> q_free;
  std::vector<std::vector<double>> rho;  // by cluster
  std::vector<int> sign;
};

class Parametrization : public Branches {
 public:
  explicit Parametrization(const Mechanism& mechanism) : Branches(mechanism) {
    first_.resize(m.nq), q_ahead_.resize(m.n_q), here_.resize(m.nq);
  }

  // σ(q) from a start; false where no proven path leads there. With `rho` false: q′ alone.
  bool sigma(const double* q, const double* start, bool rho = true) {
    wants_rho_ = rho;
    for (size_t k = 0; k < m.clusters.size(); ++k)
      if (!solve(m.clusters[k], states[k], q, start)) return false;
    return true;
  }
  bool sigma(const double* q, const ClosedPoint& near, bool rho = true) {
    wants_rho_ = rho;
    for (size_t k = 0; k < m.clusters.size(); ++k)
      if (!solve_near(int(k), q, near) && !solve(m.clusters[k], states[k], q, near.q_free.data())) return false;
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

 private:
  static constexpr double kTrusted = 1. / 64;
  std::vector<double> q_ahead_, here_, tangent_;
  bool wants_rho_ = true, open_ = false;

  // By one solve from the start, or along the straight line from α(start) to q in steps that are proven, each as long as
  // it may be; an open start is closed first.
  bool solve(const Cluster& c, ClusterState& s, const double* q, const double* start) {
    copy_cluster(c, start, here_.data());
    double left = 1, most = 1;
    for (int step = 0; step < kMaxWalking && left * most >= kShortestStep; ++step) {
      double part = most;
      const bool solved = newton(c, s, q, here_.data(), part);
      if (open_ && (!solved || part < 1)) {
        if (!close_start(c, s, here_.data())) return false;
        continue;
      }
      if (!solved) {
        most = 0.5 * part;
        continue;
      }
      if (part == 1) return true;
      copy_cluster(c, q_free.data(), here_.data());
      left *= 1 - part, most = 1;
    }
    return false;
  }

  // One Newton solve on ψ̄ (11) from a start: to q, or to the part of the way there that is proven (at most `part`).
  bool newton(const Cluster& c, ClusterState& s, const double* q, const double* start, double& part) {
    copy_cluster(c, start, q_free.data()), copy_cluster(c, start, first_.data());
    const double size = linearize(c, s, q);
    open_ = false;
    for (int r = 0; r < c.phi_rows(); ++r) open_ |= std::abs(s.residual[r]) > kOpenStart;
    if (too_singular(c, s)) return part = 0, false;
    if (size <= m.tolerance) return part = 1, wants_rho_ ? finish(c, s) : true;
    double length = newton_step(c, s);
    if (part == 1 && !open_ && s.factor.ratio >= kSuspiciousPivots) {
      tangent_ = s.step;
      if (short_enough(c, s, tangent_.data())) {
        move(c, tangent_.data());
        if (converge(c, s, q, length, s.factor.sign, 1, wants_rho_, tangent_.data())) return true;
        copy_cluster(c, start, q_free.data());
        linearize(c, s, q);
        length = newton_step(c, s);
      }
    }
    const double proven_part = prove(c, s);
    if (proven_part < part || part < 1) {
      const double f = std::min(proven_part, part) / proven_part;
      part = std::min(proven_part, part);
      if (!(part > 0)) return part = 0, false;
      for (double& x : end_) x *= f;
      if (open_ && part < 1) return true;
      s.step = end_, length *= part;
      for (int i : c.coordinates) target(m.coordinates[i], q, part);
    }
    move(c, s.step.data());
    const double* aim = part < 1 ? q_ahead_.data() : q;
    return converge(c, s, aim, length, s.factor.sign, s.factor.ratio >= kSuspiciousPivots, part == 1 && wants_rho_) && proven(c);
  }

  // From a closed point, where ρ Δq is short and the correction after it small.
  bool solve_near(int cluster, const double* q, const ClosedPoint& near) {
    const Cluster& c = m.clusters[cluster];
    ClusterState& s = states[cluster];
    if (!c.n()) return false;
    copy_cluster(c, near.q_free.data(), q_free.data());
    const double length = tangent_step(c, s, q, near.rho[cluster].data());
    tangent_ = s.step;
    move(c, s.step.data());
    return converge(c, s, q, length, near.sign[cluster], 0, wants_rho_, tangent_.data());
  }

  // Newton's iteration after a first step of a length. A factor serves two corrections (Shamanskii's method, of third
  // order): the second one, ψ̄ anew but ψ_q′ that of the iterate before, is taken where it is at most a sixteenth of the
  // first; a third where it will be the last. Where the first step is not proven (`unproven`), it must be short, and what
  // follows it at most a 64th of it, by ψ_q′ at one of its ends.
  bool converge(const Cluster& c, ClusterState& s, const double* q, double last, int sign, int served, bool rho,
                const double* unproven = nullptr) {
    for (int iteration = 1; iteration < kMaxNewton; ++iteration) {
      const double size = residuals(c, s, q);
      const bool closed = size <= m.tolerance || (last <= kNoise && size <= 100 * m.tolerance);
      if (closed && !rho && (served || !unproven || iteration > 1)) return true;
      if (served && !closed && last > kNoise) {
        const double length = newton_step(c, s);
        if (unproven && iteration == 1 && !(length <= kTrusted * last)) return false;
        if (length <= kChord * last && (served == 1 || length * length <= last * m.tolerance)) {
          last = length, ++served;
          move(c, s.step.data());
          continue;
        }
      }
      factorize(c, s);
      if (too_singular(c, s) || s.factor.sign != sign) return false;
      if (unproven && iteration == 1 && !served && !short_enough(c, s, unproven)) return false;
      if (closed) return finish(c, s);
      const double length = newton_step(c, s);
      if (unproven && iteration == 1 && !(length <= kTrusted * last || length <= kNoise)) return false;
      if (!(length <= kContraction * last || length <= kNoise)) return false;
      last = length;
      served = s.factor.ratio >= kSuspiciousPivots;
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
    for (int j : c.joints) retract(m.joints[j].kind, q_free.data() + m.joints[j].q, step + m.column_of[m.joints[j].v]);
  }

  // The part of the way from a start, whose gaps to q are at hand, into `q_ahead_`.
  void target(const Coordinate& k, const double* q, double part) {
    const double* x = first_.data() + m.joints[k.joint].q;
    double step[6];
    if (k.whole()) std::copy(x, x + k.nq, q_ahead_.data() + k.q);
    else q_ahead_[k.q] = component(k, x);
    coordinate_difference(k, q_ahead_.data() + k.q, q + k.q, step);
    for (int i = 0; i < k.nv; ++i) step[i] *= part;
    coordinate_retract(k, q_ahead_.data() + k.q, step);
  }

  // Closes an open start at its own q, in place, by parts of Newton steps along which ψ_q′ is proven regular.
  bool close_start(const Cluster& c, ClusterState& s, double* start) {
    std::vector<double> q(m.n_q);
    alpha(start, q.data());
    for (int round = 0; round < kMaxClosing; ++round) {
      double part = 1;
      if (!newton(c, s, q.data(), start, part)) return false;
      if (part < 1 && open_) {
        copy_cluster(c, first_.data(), q_free.data());
        move(c, end_.data());
      }
      copy_cluster(c, q_free.data(), start);
      if (part == 1) return true;
    }
    return false;
  }
};

}  // namespace ccpin
