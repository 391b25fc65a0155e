// Which Newton step stays on its branch: the theorem is in ccpin.kinematics.branches, the constants in
// ccpin.kinematics.curvature. Here one cluster at a time, in the Euclidean norm of its columns over their units.
#pragma once
#include "tangent.hpp"

namespace ccpin {

// What is proven around a closed configuration x̂ of one cluster: for |Δq| in a region the solution over q̂ + Δq lies in
// the tube x̂ ⊕ ρ̂ Δq + e, |e| ≤ ε, alone. All sizes are quadratic forms in Δq.
struct Anchor {
  std::vector<double> q_free, q, rho;
  std::vector<double> metric, turning;    // n × n: t² and ν² of ρ̂ Δq
  std::vector<double> sags;               // by pair i ≤ j of Δq: ψ_q′⁻¹ψ″[ρ̂_i, ρ̂_j] (twice where i < j) over units
  double second = 0, third = 0, noise = 0;
  double reach = 0, radius = 0;           // every step with t ≤ reach is proven, with this ε
};

class Branches : public Tangent {
 public:
  explicit Branches(const Mechanism& mechanism) : Tangent(mechanism) {}

 protected:
  struct Tube { double part, radius; };
  std::vector<double> start_, end_;  // of the step proven last: x, and u by local column
  double radius_ = 0;                // ε

  // How much of the step s.step from `start_`, where the cluster is factorised, stays on its branch.
  double prove(const Cluster& c, ClusterState& s) {
    end_ = s.step;
    if (!c.unknowns()) return radius_ = INFINITY, 1;
    const double size = length(c, end_.data());
    const Bounds b = bounds(c, s, 2 * std::min(size, kLongest));
    Tube found = tube(1, size, b.second * size, 0.5 * b.second * size * size, b.second, 0, b.noise);
    if (!(found.part > 0)) {
      const double turning = turned(c, s, end_.data());
      found = longest(size, turning, 0.5 * size_of(c, s.bias.data()), b);
    }
    radius_ = found.radius;
    for (double& x : end_) x *= found.part;
    return found.part;
  }

  // Whether the cluster's configuration is the solution proven.
  bool proven(const Cluster& c) const {
    return !(radius_ < INFINITY) || distance(c, start_.data(), end_.data()) <= radius_;
  }

  // What is proven around the cluster's configuration, which is closed and factorised, ρ being known.
  void anchor(const Cluster& c, ClusterState& s, Anchor& a) {
    const int n = c.n(), unknowns = c.unknowns(), width = c.width();
    a.q_free = q_free, a.rho = s.rho, a.reach = 0;
    if (!unknowns) return;
    const Bounds b = bounds(c, s, kBall);
    a.second = b.second, a.third = b.third, a.noise = b.noise;
    a.metric.assign(size_t(n) * n, 0.), a.turning = a.metric;
    a.sags.assign(size_t(n) * (n + 1) / 2 * unknowns, 0.);
    slices_.resize(n), column_.resize(width);
    for (int i = 0; i < n; ++i) {
      for (int col = 0; col < width; ++col) column_[col] = s.rho[size_t(col) * n + i];
      turned(c, s, column_.data());
      slices_[i] = turning_;
    }
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) {
        for (int col = 0; col < width; ++col)
          a.metric[size_t(i) * n + j] += s.rho[size_t(col) * n + i] * s.rho[size_t(col) * n + j] / (c.units[col] * c.units[col]);
        for (size_t k = 0; k < turning_.size(); ++k) a.turning[size_t(i) * n + j] += slices_[i][k] * slices_[j][k];
      }
    double* sag = a.sags.data();
    for (int i = 0; i < n; ++i)
      for (int j = i; j < n; ++j, sag += unknowns) sag_between(c, s, i, j, sag);
    widest(a, n);
  }

 private:
  static constexpr double kContractive = 0.9, kLongest = 0.5, kShorter = 0.8, kLeast = 1e-3, kBall = 0.2;
  static constexpr int kRounds = 12;
  struct Bounds { double second, third, noise; };
  std::vector<double> inverse_columns_, turning_, column_;
  std::vector<std::vector<double>> slices_;
};

}  // namespace ccpin
