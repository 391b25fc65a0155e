// q′ = σ(q) (12), cluster by cluster; its steps are proven as in ccpin.kinematics.parametrization.
//
// Clusters share no row and no column of ψ, so each is solved alone: a step that one cluster does not trust shortens the
// way of that cluster only, and the branch reached is the same.
#pragma once
#include "branches.hpp"

namespace ccpin {

constexpr double kChord = 0.0625, kNoise = 1e-9;
constexpr double kStill = 1e-3;  // of the inverse of ψ_q′ times the way since it was factorised
constexpr double kShortestStep = 0x1p-30, kOpenStart = 1e-6;
constexpr int kMaxNewton = 16, kMaxClosing = 60;

// A closed point, as a start: its ρ spares Newton the first evaluation, and a proof where q is not further than `way`.
struct ClosedPoint {
  std::vector<double> q_free;
  std::vector<std::vector<double>> rho;  // by cluster
  std::vector<int> sign;
  std::vector<double> way;               // the largest |Δq| of which every step is proven
  std::vector<std::vector<double>> radius;
};

class Parametrization : public Branches {
 public:
  explicit Parametrization(const Mechanism& mechanism) : Branches(mechanism) {
    q_start_.resize(m.n_q), q_ahead_.resize(m.n_q), line_.resize(m.n), here_.resize(m.nq);
  }

  // σ(q) from a start; false where the trusted path does not lead there. With `rho` false: q′ alone.
  bool sigma(const double* q, const double* start, bool rho = true) {
    wants_rho_ = rho;
    for (size_t k = 0; k < m.clusters.size(); ++k)
      if (!solve(int(k), q, start, nullptr)) return false;
    return true;
  }
  bool sigma(const double* q, const ClosedPoint& near, bool rho = true) {
    wants_rho_ = rho;
    for (size_t k = 0; k < m.clusters.size(); ++k)
      if (!solve(int(k), q, near.q_free.data(), &near)) return false;
    return true;
  }
  void remember(ClosedPoint& point) {
    const size_t count = states.size();
    point.q_free = q_free;
    point.rho.resize(count), point.sign.resize(count), point.way.resize(count), point.radius.resize(count);
    for (size_t k = 0; k < count; ++k) {
      point.rho[k] = states[k].rho, point.sign[k] = states[k].factor.sign;
      point.way[k] = free_way(m.clusters[k], states[k], starts_[k], point.radius[k]);
    }
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
  std::vector<double> q_start_, q_ahead_, line_, here_, first_;
  static constexpr double kRounding = 1e-12;
  bool wants_rho_ = true;

  bool solve(int k, const double* q, const double* start, const ClosedPoint* near) {
    bool open = false;
    if (near && newton(k, q, start, near, open)) return true;
    if (newton(k, q, start, nullptr, open)) return true;
    if (open && !close_start(k, start)) return false;
    return walk(k, q, open ? here_.data() : start);
  }

  // One Newton solve on ψ̄ (11) whose first step is proven to end on its branch, and which ends in the box that holds no
  // other solution. Where ρ at a closed start is known and q is near enough, the first step is ρ Δq and proven already.
  //
  // A factor serves two corrections (Shamanskii's method, of third order): the second one, ψ̄ anew but ψ_q′ that of the
  // iterate before, is taken where it is at most a sixteenth of the first. A third is taken where it will be the last. Where q′ alone is wanted the solution needs no
  // ψ_q′ of its own if the last one's inverse times the way since is so small that the determinant cannot vanish on it.
  bool newton(int cluster, const double* q, const double* start, const ClosedPoint* near, bool& open) {
    const Cluster& c = m.clusters[cluster];
    ClusterState& s = states[cluster];
    first_.resize(m.nq);
    copy_cluster(c, start, q_free.data()), copy_cluster(c, start, first_.data());
    const int first = near && c.n() ? 1 : 0;
    int sign = near ? near->sign[cluster] : 0;
    double last = INFINITY;
    bool proven = false;
    if (first) {
      last = tangent_step(c, s, q, near->rho[cluster].data());
      for (int i = 0; i < c.n(); ++i)
        if (!(std::abs(s.right[i]) <= near->way[cluster])) return false;
      centre_.assign(c.width(), 0.), radius_ = near->radius[cluster], proven = true;
      move(c, s.step.data());
    }
    int served = 0;              // corrections that the factor at hand has made
    double inverse = 0, way = 0;  // the size of its inverse, and the length of these
    for (int iteration = first; iteration < kMaxNewton; ++iteration) {
      const double size = residuals(c, s, q);
      const bool closed = size <= m.tolerance || (iteration && last <= kNoise && size <= 100 * m.tolerance);
      if (served && closed && !wants_rho_ && inverse * way <= kStill) return same(c, proven);
      if (served && !closed && last > kNoise) {
        const double length = newton_step(c, s);
        if (length <= kChord * last && (served == 1 || length * length <= last * m.tolerance)) {
          last = length, way += length, ++served;
          move(c, s.step.data());
          continue;
        }
      }
      factorize(c, s);
      if (iteration == 0) {
        sign = s.factor.sign;
        for (int r = 0; r < c.phi_rows(); ++r) open |= std::abs(s.residual[r]) > kOpenStart;
      }
      if (too_singular(c, s) || s.factor.sign != sign) return false;
      if (closed) return same(c, proven) && finish(c, s);
      const double length = newton_step(c, s);
      if (!(length <= last || length <= kNoise)) return false;
      if (!proven && !(prove(c, s, starts_[cluster]) == 1)) return false;
      proven = true;
      last = way = length;
      served = s.factor.ratio >= kSuspiciousPivots;
      inverse = inverse_size(c, s);
      move(c, s.step.data());
    }
    return false;
  }

  // Whether the solution found is the one proven.
  bool same(const Cluster& c, bool proven) {
    if (!proven) return true;
    double moved[6];
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      difference(joint.kind, first_.data() + joint.q, q_free.data() + joint.q, moved);
      for (int k = 0; k < joint.nv; ++k) {
        const int col = m.column_of[joint.v + k];
        if (!(std::abs(moved[k] - centre_[col]) <= radius_[col] + kRounding)) return false;
      }
    }
    return true;
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

  // Along the straight line from α(start) to q, in steps that Newton trusts.
  bool walk(int cluster, const double* q, const double* start) {
    const Cluster& c = m.clusters[cluster];
    alpha(start, q_start_.data());
    for (int i : c.coordinates) {
      const Coordinate& k = m.coordinates[i];
      coordinate_difference(k, q_start_.data() + k.q, q + k.q, line_.data() + k.v);
    }
    copy_cluster(c, start, here_.data());
    double done = 0, stride = 0.5;
    bool open = false;
    while (stride >= kShortestStep) {
      const double ahead = std::min(1.0, done + stride);
      for (int i : c.coordinates) target(m.coordinates[i], q, ahead);
      part_ = 0, likely_ = 2;
      if (!newton(cluster, q_ahead_.data(), here_.data(), nullptr, open)) {
        stride = std::min(0.8, part_) * (ahead - done);
        continue;
      }
      if (ahead == 1) return true;
      copy_cluster(c, q_free.data(), here_.data());
      stride = std::min(2.0, likely_) * (ahead - done), done = ahead;
    }
    return false;
  }
  void target(const Coordinate& k, const double* q, double ahead) {
    const double* from = ahead == 1 ? q : q_start_.data();
    std::copy(from + k.q, from + k.q + k.nq, q_ahead_.data() + k.q);
    if (ahead == 1) return;
    double step[6];
    for (int i = 0; i < k.nv; ++i) step[i] = ahead * line_[k.v + i];
    coordinate_retract(k, q_ahead_.data() + k.q, step);
  }

  // Closes an open guess at its own q, into `here_`, by parts of Newton steps along which ψ_q′ is proven regular.
  bool close_start(int cluster, const double* start) {
    const Cluster& c = m.clusters[cluster];
    alpha(start, q_start_.data());
    copy_cluster(c, start, here_.data());
    bool open;
    for (int round = 0; round < kMaxClosing; ++round) {
      part_ = 0;
      const bool closed = newton(cluster, q_start_.data(), here_.data(), nullptr, open);
      if (closed) {
        copy_cluster(c, q_free.data(), here_.data());
        return true;
      }
      if (part_ < kShortestStep) return false;
      copy_cluster(c, here_.data(), q_free.data());
      ClusterState& s = states[cluster];
      linearize(c, s, q_start_.data());
      newton_step(c, s);
      for (double& x : s.step) x *= std::min(0.5, part_);
      move(c, s.step.data());
      copy_cluster(c, q_free.data(), here_.data());
    }
    return false;
  }
};

}  // namespace ccpin
