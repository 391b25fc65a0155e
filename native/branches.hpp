// Which Newton step stays on its branch: the theorem is in ccpin.kinematics.branches. Here for one cluster at a time.
#pragma once
#include "curvature.hpp"

namespace ccpin {

class Branches : public Curvature {
 public:
  using Curvature::Curvature;

 protected:
  struct Tube { double part, radius; };
  std::vector<double> first_, end_;  // of the step proven last: its start x (of q′), and f u by local column
  double radius_ = 0;                // ε
  bool by_rows_ = false;             // whether in the norm |d|* = ‖ψ_q′⁻¹‖|ψ_q′ d|

  // How much of the step s.step from `first_`, where the cluster is factorised, stays on its branch.
  double prove(const Cluster& c, ClusterState& s) {
    end_ = s.step, radius_ = INFINITY, by_rows_ = false;
    if (!c.unknowns()) return 1;
    const double t = length(c, end_.data()), y = inverse_size(c, s), noise = noise_of(c, y);
    Bent b = bounds(c, 2 * std::min(t, kLongest) + 8 * noise);
    b.second *= y, b.third *= y;
    Tube found = tube(t, b.second * t, 0.5 * b.second * t * t, {b.second}, noise, 1);
    if (!(found.part > 0)) {
      const double turning = turned(c, s, end_.data());
      along(c, thirds_, end_.data(), b, y);
      found = longest(t, turning, 0.5 * length(c, s.bias.data()), b, noise);
      if (found.part < kFair) {
        const Tube other = longest(t, turned_after(c), 0.5 * y * row_length(c, end_.data()), b, noise);
        by_rows_ = other.part > found.part;
        if (by_rows_) found = other, before_ = s.J, scaled_ = y;
      }
    }
    for (double& x : end_) x *= found.part;
    radius_ = found.radius;
    return found.part;
  }

  // Whether the cluster's configuration is the solution proven.
  bool proven(const Cluster& c) {
    const Scale& scale = scale_of(c);
    step_.resize(c.width());
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      const int first = m.column_of[joint.v];
      difference(joint.kind, first_.data() + joint.q, q_free.data() + joint.q, step_.data() + first);
    }
    for (int col = 0; col < c.width(); ++col) step_[col] -= end_[col];
    if (!by_rows_) return length(c, step_.data()) <= radius_;
    double sum = 0;
    for (int r = 0; r < c.rows(); ++r) {
      double x = 0;
      for (int col = 0; col < c.width(); ++col) x += before_[size_t(r) * c.width() + col] * step_[col];
      sum += x * x / (scale.rows[r] * scale.rows[r]);
    }
    return scaled_ * std::sqrt(sum) <= radius_;
  }

  // Whether a step s.step by the factor at hand is far from where it could leave its branch, by estimates: short, and
  // ‖ψ_q′⁻¹‖ as told by a right side of no structure, times how the rows bend, times its length, below 0.6 (½ if neither overestimated).
  bool short_enough(const Cluster& c, ClusterState& s, const double* step) {
    if (!c.unknowns()) return true;
    const Scale& scale = scale_of(c);
    const double t = length(c, step);
    if (!(t <= kShort)) return false;
    double x = 0.5, largest = 0;
    for (int r = 0; r < c.rows(); ++r) x = 3.9 * x * (1 - x), s.right[r] = scale.rows[r] * (r % 2 ? x + 0.1 : -x - 0.1);
    s.factor.solve(s.right.data(), 1);
    for (int k = 0; k < c.unknowns(); ++k)
      largest = std::max(largest, std::abs(s.right[c.pattern.slots[k]]) / scale.columns[c.dependent[k]]);
    return largest * scale.bending * t <= kSmall;
  }

 private:
  static constexpr double kShort = 0.1, kSmall = 0.6;
  static constexpr double kContractive = 0.9, kLongest = 0.5, kShorter = 0.8, kFair = 0.5;
  static constexpr int kRounds = 12, kTrials = 16;
  std::vector<double> square_, inverse_, rate_, turning_, step_, before_;
  double scaled_ = 0;  // ‖ψ_q′⁻¹‖ at `before_`

  double length(const Cluster& c, const double* step) const {
    const Scale& scale = scale_of(c);
    double sum = 0;
    for (int col = 0; col < c.width(); ++col) sum += std::pow(step[col] / scale.columns[col], 2);
    return std::sqrt(sum);
  }

  // ‖ψ_q′⁻¹‖ of the dependent columns, at most; `inverse_` is itself, times the rows' units.
  double inverse_size(const Cluster& c, const ClusterState& s) {
    const Scale& scale = scale_of(c);
    const int rows = c.rows();
    square_.assign(size_t(rows) * rows, 0.), inverse_.resize(size_t(c.unknowns()) * rows);
    for (int k = 0; k < rows; ++k) square_[size_t(k) * rows + k] = scale.rows[k];
    s.factor.solve(square_.data(), rows);
    double total = 0;
    for (int k = 0; k < c.unknowns(); ++k) {
      const double* y = square_.data() + size_t(c.pattern.slots[k]) * rows;
      double sum = 0;
      for (int r = 0; r < rows; ++r) sum += y[r] * y[r], inverse_[size_t(k) * rows + r] = y[r];
      total += sum / (scale.columns[c.dependent[k]] * scale.columns[c.dependent[k]]);
    }
    return std::sqrt(total);
  }
  double noise_of(const Cluster& c, double inverse) const {
    return inverse / std::min(scale_of(c).unit, 1.) * m.tolerance * std::sqrt(double(c.rows()));
  }

  // ν of a step; −ψ_q′⁻¹ψ″[u, u] is left in `s.bias`, ψ″[u, ·] in `rate_`, N in `turning_` (over units).
  double turned(const Cluster& c, ClusterState& s, const double* step) {
    const Scale& scale = scale_of(c);
    const int rows = c.rows(), n = c.unknowns(), width = c.width();
    bias(c, s, step);
    rate_.assign(size_t(rows) * width, 0.), square_.resize(size_t(rows) * n), turning_.resize(size_t(n) * n);
    jacobian_rate(c, s, step, [&](int row, int col, double rate) { rate_[size_t(row) * width + col] += rate; });
    straighten(c, s, step);
    for (int r = 0; r < rows; ++r)
      for (int k = 0; k < n; ++k) square_[size_t(r) * n + k] = rate_[size_t(r) * width + c.dependent[k]];
    s.factor.solve(square_.data(), n);
    double sum = 0;
    for (int k = 0; k < n; ++k) {
      const double* y = square_.data() + size_t(c.pattern.slots[k]) * n;
      const double unit = 1 / scale.columns[c.dependent[k]];
      for (int i = 0; i < n; ++i) {
        const double x = y[i] * scale.columns[c.dependent[i]] * unit;
        turning_[size_t(k) * n + i] = x, sum += x * x;
      }
    }
    return std::sqrt(sum);
  }
  // ν in the norm of rows: of ψ″[u, ψ_q′⁻¹ ·]. After `inverse_size` and `turned`.
  double turned_after(const Cluster& c) const {
    const Scale& scale = scale_of(c);
    const int rows = c.rows(), n = c.unknowns(), width = c.width();
    double total = 0;
    for (int r = 0; r < rows; ++r)
      for (int o = 0; o < rows; ++o) {
        double sum = 0;
        for (int k = 0; k < n; ++k) sum += rate_[size_t(r) * width + c.dependent[k]] * inverse_[size_t(k) * rows + o];
        total += sum * sum / (scale.rows[r] * scale.rows[r]);
      }
    return std::sqrt(total);
  }
  // |ψ″[u, u]|, after `turned`.
  double row_length(const Cluster& c, const double* step) const {
    const Scale& scale = scale_of(c);
    double total = 0;
    for (int r = 0; r < c.rows(); ++r) {
      double sum = 0;
      for (int col = 0; col < c.width(); ++col) sum += rate_[size_t(r) * c.width() + col] * step[col];
      total += sum * sum / (scale.rows[r] * scale.rows[r]);
    }
    return std::sqrt(total);
  }

  // Velocities in ψ̇_q′ are those of moving frames; in `rate_` they become those of exponential coordinates.
  void straighten(const Cluster& c, const ClusterState& s, const double* step) {
    const int width = c.width();
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      if (joint.nv < 3) continue;
      const int first = m.column_of[joint.v];
      const double* v = step + first;
      const bool planar = joint.kind == Kind::planar, slides = joint.kind == Kind::floating;
      const Vec3 w = planar ? Vec3(0, 0, v[2]) : slides ? Vec3(v[3], v[4], v[5]) : Vec3(v[0], v[1], v[2]);
      const Vec3 x = planar ? Vec3(v[0], v[1], 0) : slides ? Vec3(v[0], v[1], v[2]) : Vec3(0, 0, 0);
      Eigen::Matrix<double, 6, 6> bracket = Eigen::Matrix<double, 6, 6>::Zero();
      bracket.topLeftCorner<3, 3>() = bracket.bottomRightCorner<3, 3>() = skew(w);
      bracket.topRightCorner<3, 3>() = skew(x);
      const int entry[6] = {planar || slides ? 0 : 3, planar || slides ? 1 : 4, planar ? 5 : slides ? 2 : 5, 3, 4, 5};
      for (int r = 0; r < c.rows(); ++r)
        for (int b = 0; b < joint.nv; ++b)
          for (int a = 0; a < joint.nv; ++a)
            rate_[size_t(r) * width + first + b] -= 0.5 * s.J[size_t(r) * width + first + a] * bracket(entry[a], entry[b]);
    }
  }

  // The theorem for given t, ν, s₂, bounds, and f; part 0 where no ε is found.
  static Tube tube(double size, double turning, double sag, const Bent& b, double noise, double part) {
    const double way = part * size, bent = part * turning, along = part * part * b.along;
    const double start = part * part * sag + part * part * part * b.thrice / 6 + 4 * noise;
    double e = start;
    for (int round = 0; round < kRounds; ++round) {
      if (!(e <= way + 8 * noise && way <= kLongest)) break;
      const double need = start + (bent + 0.5 * along) * e + 0.5 * (b.second + b.third * way) * e * e + b.third * e * e * e / 6;
      if (need <= e) {
        if (bent + b.second * e + 0.5 * along + b.third * (way + 0.5 * e) * e <= kContractive) return {part, e};
        break;
      }
      e = 1.05 * need;
    }
    return {0, 0};
  }
  static Tube longest(double size, double turning, double sag, const Bent& b, double noise) {
    // A little more than what the theorem's terms allow one by one.
    const double root = std::sqrt(sag * b.second) + std::sqrt(0.5 * b.along);
    double part = std::min(1., 1.2 * std::min(kLongest / size, kContractive / (turning + root)));
    for (int trial = 0; trial < kTrials; ++trial, part *= kShorter) {
      const Tube found = tube(size, turning, sag, b, noise, part);
      if (found.part > 0) return found;
    }
    return {0, 0};
  }
};

}  // namespace ccpin
