// Planar bounds, for φ a sum of phasors: sharp in the sines and cosines of the links' angles (`proof/phasors.py`).
#pragma once
#include "bounds.hpp"

namespace ccpin::certificates {

class PlanarBounds final : public Bounds {
 public:
  explicit PlanarBounds(const Closures& c) : Bounds(c), K_(c.phasors.count) {
    versine_.resize(K_), sine_.resize(K_), cube_.resize(K_), turn_.resize(K_);
  }

  void mean(const Doubles& radius, Image& out) override {
    turns(radius);
    for (int k = 0; k < K_; ++k) {
      const double a = angle_[k], b = turn_[k];
      versine_[k] = 0.5 * (a * a + a * b + b * b / 3);
      sine_[k] = std::sin(std::min(a + 0.5 * b, kQuarter));
      cube_[k] = (4 * a * a * a + 6 * a * a * b + 4 * a * b * b + b * b * b) / 24;
    }
    image(radius, 0.5, out);
  }

  void contraction(const Doubles& radius, const Doubles&, Image& out) override {
    turns(radius);
    for (int k = 0; k < K_; ++k) {
      const double a = angle_[k] + turn_[k];
      versine_[k] = versine(a), sine_[k] = std::sin(std::min(a, kQuarter)), cube_[k] = a * a * a / 6;
    }
    image(radius, 1, out);
  }

 private:
  static constexpr double kQuarter = 1.5707963267948966;
  const int K_;
  Doubles alpha_, kappa_, modes_, along_, angle_, mixed_;  // α, κ (m, K); CE (K, m); CD (K, p); |CD|h; |αᵀ(CE)(C[D, E])|
  Doubles versine_, sine_, cube_, turn_, width_;

  static double versine(double angle) {  // the largest 1 − cos u for |u| ≤ angle
    const double s = std::sin(0.5 * std::min(angle, 2 * kQuarter));
    return 2 * s * s;
  }

  void curved(const Box& box, const Values& at) override {
    const int m = closures.m;
    alpha_.assign(size_t(m) * K_, 0.), kappa_ = alpha_;
    for (int i = 0; i < m; ++i)
      for (int k = 0; k < m; ++k) {
        add_scaled(alpha_.data() + i * K_, box.preconditioner[i * m + k], at.along.data() + k * K_, K_);
        add_scaled(kappa_.data() + i * K_, box.preconditioner[i * m + k], at.across.data() + k * K_, K_);
      }
    turn_links(box);
    mix();
    for (int i = 0; i < m; ++i) y[i] += second_order(i);
  }

  // CD, CE and |CD|h.
  void turn_links(const Box& box) {
    const int m = closures.m, n_free = closures.n_free;
    const Doubles& signs = closures.phasors.signs;
    along_.assign(size_t(K_) * p, 0.), modes_.assign(size_t(K_) * m, 0.), angle_.assign(K_, 0.);
    for (int k = 0; k < K_; ++k) {
      for (int c = 0; c < n_free; ++c)
        add_scaled(along_.data() + k * p, signs[k * n_free + c], box.directions.data() + c * p, p);
      for (int c = 0; c < m; ++c)
        add_scaled(&modes_[k * m], signs[k * n_free + closures.dependent[c]], &box.modes[c * m], m);
      for (int e = 0; e < p; ++e) angle_[k] += std::abs(along_[k * p + e]) * half[e];
    }
  }

  void mix() {
    const int m = closures.m;
    mixed_.resize(size_t(m) * m * (p + m));
    double* out = mixed_.data();
    for (int i = 0; i < m; ++i)
      for (int e = 0; e < m; ++e)
        for (int w = 0; w < p + m; ++w, ++out) {
          double sum = 0;
          for (int k = 0; k < K_; ++k)
            sum += alpha_[i * K_ + k] * modes_[k * m + e] * (w < p ? along_[k * p + w] : modes_[k * m + w - p]);
          *out = std::abs(sum);
        }
  }

  // The bound of |Σ α (cos u − 1) + κ (sin u − u)| at ζ = 0: what Y has beyond its linear part.
  double second_order(int i) const {
    double up = 0, down = 0, fourth = 0, cubic = 0, square = 0;
    for (int k = 0; k < K_; ++k) {
      const double a = angle_[k], c = alpha_[i * K_ + k] * versine(a), cube = a * a * a;
      (c > 0 ? up : down) += std::abs(c);
      fourth += std::abs(alpha_[i * K_ + k]) * (cube * a / 24), cubic += std::abs(kappa_[i * K_ + k]) * (cube / 6);
    }
    for (int e = 0; e < p; ++e)
      for (int f = 0; f < p; ++f) {
        double sum = 0;
        for (int k = 0; k < K_; ++k) sum += alpha_[i * K_ + k] * along_[k * p + e] * along_[k * p + f];
        square += half[e] * std::abs(sum) * half[f];
      }
    return std::min(std::max(up, down), 0.5 * square + fourth) + cubic;
  }

  // |CE|R.
  void turns(const Doubles& radius) {
    const int m = closures.m;
    for (int k = 0; k < K_; ++k) {
      turn_[k] = 0;
      for (int e = 0; e < m; ++e) turn_[k] += std::abs(modes_[k * m + e]) * radius[e];
    }
  }

  // |I − Ãφ_θE| + the smaller bound of |Σ α sin u (CE)| + |Σ κ (1 − cos u)(CE)|; `part` · R is R in |N|(h, R).
  void image(const Doubles& radius, double part, Image& out) {
    const int m = closures.m;
    widths(radius, width_), affine(width_, out.columns), out.rest.assign(m, 0.);
    const double* line = mixed_.data();
    for (int i = 0; i < m; ++i)
      for (int e = 0; e < m; ++e, line += p + m) {
        double expanded = 0, whole = 0, up = 0, down = 0;
        for (int w = 0; w < p + m; ++w) expanded += line[w] * (w < p ? half[w] : part * radius[w - p]);
        for (int k = 0; k < K_; ++k) {
          const double mode = modes_[k * m + e], a = std::abs(alpha_[i * K_ + k] * mode);
          const double c = kappa_[i * K_ + k] * mode * versine_[k];
          expanded += a * cube_[k], whole += a * sine_[k], (c > 0 ? up : down) += std::abs(c);
        }
        out.columns[e * m + i] += std::min(expanded, whole) + std::max(up, down);
      }
  }
};

}  // namespace ccpin::certificates
