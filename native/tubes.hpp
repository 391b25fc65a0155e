// Newton's method and the certified iteration at fixed q, and whether two boxes carry the same σ (`proof/newton.py`, `proposals/solving.py`).
#pragma once
#include "krawczyk.hpp"

namespace ccpin::certificates {

class Tubes {
 public:
  explicit Tubes(const Closures& c) : c_(c), krawczyk_(c), solver_(c.m) {}

  // Newton steps in the dependent coordinates of θ; whether the last was below `accuracy` and none above 1.5.
  // `slopes` (m, n) becomes −φ_y⁻¹φ_q one step before.
  bool newton(double* theta, int iterations, double accuracy, double* slopes) {
    bool settled = false, alive = true;
    for (int k = 0; k < iterations && alive && !settled; ++k) {
      if (!step(theta)) break;
      double length = 0;
      for (double x : step_) length = std::max(length, std::abs(x));
      alive = length < 1.5, settled = length < accuracy;
      for (int r = 0; alive && r < c_.m; ++r) theta[c_.dependent[r]] += step_[r];
    }
    find_slopes(slopes);
    return settled;
  }

  // Whether two proved boxes carry the same solution at a common point of both, given by each one's parameters (`glued`). What
  // encloses it already before rounding is reached does so there too.
  bool glued(const Box& first, const double* delta, const Box& second, const double* delta_second) {
    if (!within(c_, first, delta) || !within(c_, second, delta_second)) return false;
    const auto met = [&] { return encloses(second, delta_second, theta_, error_, first.modes, first.plain); };
    const Found found = solve(first, delta, met);
    if (found != Found::solved) return found == Found::met;
    return krawczyk_.certify_point(theta_.data(), point_) &&
           encloses(first, delta, point_.centre, point_.radius, point_.modes, false) &&
           encloses(second, delta_second, point_.centre, point_.radius, point_.modes, false);
  }

 private:
  const Closures& c_;
  Krawczyk krawczyk_;
  Solver solver_;
  Values at_;
  Box point_;
  Doubles step_, residual_, zeta_, trial_, theta_, error_, matrix_, inverse_, base_, gap_, reach_;
  bool usable_ = true;  // whether φ_y has an inverse where `step` was last

  // φ_y at the point last evaluated, factorised; NaN steps where it is singular.
  bool factorize() {
    const int m = c_.m;
    matrix_.resize(size_t(m) * m);
    for (int r = 0; r < m; ++r)
      for (int k = 0; k < m; ++k) matrix_[r * m + k] = at_.jacobian[r * c_.n_free + c_.dependent[k]];
    return usable_ = solver_.factorize(matrix_.data());
  }

  // The Newton step −φ_y⁻¹φ of the dependent coordinates; false where there is none.
  bool step(const double* theta) {
    c_.evaluate(theta, at_);
    if (!factorize()) return false;
    step_ = at_.phi;
    solver_.solve(step_.data());
    for (double& x : step_) x = -x;
    return true;
  }

  void find_slopes(double* slopes) {
    for (int r = 0; r < c_.m; ++r)
      for (int k = 0; k < c_.n; ++k)
        slopes[r * c_.n + k] = usable_ ? -at_.jacobian[r * c_.n_free + c_.independent[k]] : NAN;
    if (usable_) solver_.solve(slopes, c_.n);
  }

  // θ_c + Dδ + Eζ.
  void predict(const Box& box, const double* delta, const Doubles* zeta, Doubles& theta) const {
    const int p = box.parameters(), m = c_.m;
    theta = box.centre;
    for (int k = 0; k < c_.n_free; ++k) {
      double moved = 0;
      for (int e = 0; e < p; ++e) moved += box.directions[k * p + e] * delta[e];
      theta[k] += moved;
    }
    for (int k = 0; zeta && k < m; ++k) {
      double moved = box.plain ? (*zeta)[k] : 0;
      for (int e = 0; !box.plain && e < m; ++e) moved += box.modes[k * m + e] * (*zeta)[e];
      theta[c_.dependent[k]] += moved;
    }
  }

  // f = Ãφ and its norm at ζ, of which `theta_` is left.
  double evaluate(const Box& box, const double* delta, const Doubles& zeta) {
    const int m = c_.m;
    predict(box, delta, &zeta, theta_);
    c_.evaluate(theta_.data(), at_);
    residual_.assign(m, 0.);
    double size = 0;
    for (int i = 0; i < m; ++i) {
      for (int k = 0; k < m; ++k) residual_[i] += box.preconditioner[i * m + k] * at_.phi[k];
      const double part = std::abs(residual_[i]) / box.weight[i];
      if (!(part <= size)) size = part;  // NaN stays
    }
    return size;
  }

  // ζ + the Newton step (V⁻¹φ_y⁻¹φ, from the point last evaluated), or NaN.
  void newton_trial(const Box& box) {
    const int m = c_.m;
    trial_.assign(m, NAN);
    if (!factorize()) return;
    step_ = at_.phi;
    solver_.solve(step_.data());
    if (!box.plain) {
      if (!solver_.factorize(box.modes.data())) return;
      solver_.solve(step_.data());
    }
    for (int i = 0; i < m; ++i) trial_[i] = zeta_[i] - step_[i];
  }

  enum class Found { met, solved, nothing };

  // σ at |δ| ≤ h of a proved box, to rounding or until `met()` holds for what is known: it is `theta_`, within V · `error_`
  // (`solve_in_boxes`). Every step lowers ‖f‖ by κ.
  template <class F> Found solve(const Box& box, const double* delta, F&& met) {
    const int m = c_.m;
    const double margin = rounding(box);
    zeta_.assign(m, 0.), error_.resize(m);
    double size = evaluate(box, delta, zeta_);
    for (int step = 0;; ++step) {
      for (int i = 0; i < m; ++i) error_[i] = kSlack * (size + margin) / (1 - box.kappa) * box.weight[i];
      if (met()) return Found::met;
      if (!(size > margin)) return Found::solved;
      if (step == 20000) return Found::nothing;
      const Doubles residual = residual_;
      newton_trial(box);
      bool inside = true;
      for (int i = 0; i < m; ++i) inside = inside && std::abs(trial_[i]) <= box.radius[i];
      double now = inside ? evaluate(box, delta, trial_) : 0;
      if (!inside || !(now <= box.kappa * size)) {
        for (int i = 0; i < m; ++i) trial_[i] = zeta_[i] - residual[i];
        now = evaluate(box, delta, trial_);
      }
      zeta_ = trial_, size = now;
    }
  }

  // The rounding error of ‖f‖ in the box's norm.
  double rounding(const Box& box) {
    const int m = c_.m, p = box.parameters();
    base_.resize(c_.n_free);
    for (int k = 0; k < c_.n_free; ++k) {
      base_[k] = std::abs(box.centre[k]);
      for (int e = 0; e < p; ++e) base_[k] += std::abs(box.directions[k * p + e]) * box.half[e];
    }
    double largest = 0;
    for (int i = 0; i < m; ++i) {
      double gain = 0;
      for (int k = 0; k < m; ++k) gain += std::abs(box.preconditioner[i * m + k]);
      largest = std::max(largest, gain / box.weight[i]);
    }
    return largest * c_.gamma * c_.magnitude(base_.data());
  }

  // Whether a solution known as θ + modes · [−error, error] lies in a box's tube at δ (`encloses`).
  bool encloses(const Box& box, const double* delta, const Doubles& theta, const Doubles& error, const Doubles& modes,
                bool plain) {
    constexpr double turn = 6.283185307179586;
    const int m = c_.m, p = box.parameters();
    predict(box, delta, nullptr, base_);
    gap_.resize(m), reach_.resize(m);
    for (int k = 0; k < m; ++k) {
      const int j = c_.dependent[k];
      gap_[k] = theta[j] - base_[j], reach_[k] = 1e-13 * (1 + std::abs(theta[j]));
      for (int e = 0; e < p; ++e) reach_[k] += std::abs(box.directions[j * p + e]) * blur(delta[e]);
      if (c_.periodic[j]) gap_[k] -= turn * std::nearbyint(gap_[k] / turn);
    }
    if (plain && box.plain) {
      for (int k = 0; k < m; ++k)
        if (!((std::abs(gap_[k]) + reach_[k] + error[k]) * kSlack <= box.radius[k])) return false;
      return true;
    }
    inverse_.assign(size_t(m) * m, 0.), matrix_ = modes;
    for (int k = 0; k < m; ++k) inverse_[k * m + k] = 1;
    if (!box.plain) {
      if (!solver_.factorize(box.modes.data())) return false;
      solver_.solve(inverse_.data(), m), solver_.solve(matrix_.data(), m);
    }
    for (int i = 0; i < m; ++i) {
      double away = 0, reach = 0;
      for (int k = 0; k < m; ++k) {
        away += inverse_[i * m + k] * gap_[k];
        reach += std::abs(inverse_[i * m + k]) * reach_[k] + std::abs(matrix_[i * m + k]) * error[k];
      }
      if (!((std::abs(away) + reach) * kSlack <= box.radius[i])) return false;
    }
    return true;
  }
};

}  // namespace ccpin::certificates
