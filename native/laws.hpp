// The control laws that live in the core (ccpin.control.laws and .tracking, where the motors are the independent
// joints), with e = q_d − q and ė = q̇_d − q̇:
//
//   constant         u = constant, whatever the motors
//   pd               u = K_p e + K_v ė + constant
//   pd_gravity       u = K_p e + K_v ė + g(q)
//   computed_torque  u = D (q̈_d + K_v ė + K_p e) + C q̇ + g
//   pd_plus          u = D q̈_d + C q̇_d + g + K_p e + K_v ė
//   adaptive         u = Y_r(q, q̇, q̇_d + K_p e, q̈_d + K_p ė) (known + B π̂) − K_v s,  s = q̇ − q̇_d − K_p e, sampled, and π̂ is
//                    π̂ − rates (Y_r B)ᵀs from the next sample on, within its bounds
#pragma once
#include "workspace.hpp"

namespace ccpin {

// q_d(t) = start ⊕ p(t), p a piecewise polynomial in the tangent space, at rest before and after; no pieces: a set point.
struct Path {
  std::vector<double> start, breaks;
  std::vector<double> coefficients;  // pieces × (degree + 1) × n, the highest power first
  int degree = 0;

  // q_d, q̇_d and q̈_d.
  void at(const Mechanism& m, double t, double* q, double* v, double* a) const {
    std::copy(start.begin(), start.end(), q);
    std::fill(v, v + m.n, 0.), std::fill(a, a + m.n, 0.);
    if (breaks.empty()) return;
    const double within = std::min(std::max(t, breaks.front()), breaks.back());
    const auto next = std::upper_bound(breaks.begin() + 1, breaks.end() - 1, within);
    const size_t piece = size_t(next - breaks.begin()) - 1;
    const double x = within - breaks[piece];
    std::vector<double> way(m.n, 0.);
    const double* c = coefficients.data() + (piece * (degree + 1) * m.n);
    for (int power = degree; power >= 0; --power, c += m.n)
      for (int i = 0; i < m.n; ++i) {
        a[i] = a[i] * x + 2 * v[i];
        v[i] = v[i] * x + way[i];
        way[i] = way[i] * x + c[i];
      }
    if (t < breaks.front() || t >= breaks.back()) std::fill(v, v + m.n, 0.), std::fill(a, a + m.n, 0.);
    for (const Coordinate& k : m.coordinates) coordinate_retract(k, q + k.q, way.data() + k.v);
  }
};

enum class LawKind { constant, pd, pd_gravity, computed_torque, pd_plus, adaptive };
constexpr const char* kLawNames[] = {"constant", "pd", "pd_gravity", "computed_torque", "pd_plus", "adaptive"};

// What an adaptive law looks for: k numbers π̂, of p constants known + B π̂.
struct Learning {
  std::vector<double> known, basis;                   // p, p × k
  std::vector<double> rates, lower, upper, estimate;  // k each; the estimate: at first
};

struct Law {
  LawKind kind;
  Path path;
  std::vector<double> K_p, K_v, constant;  // n × n, n × n, n (u's size where the law is that)
  Learning learning;
};

// A law at work. Its model is the plant's, closed where the motion is, or one of its own (a nominal one), which it closes
// itself at the same q, on the branch of where that is closed at first.
class LawRunner {
 public:
  std::vector<double> estimate;  // π̂ as the next sample will use it

  LawRunner(Workspace& w, const Law& law, bool own)
      : estimate(law.learning.estimate), w_(w), m_(w.model.m), law_(law), own_(own) {
    if (closes_itself()) w_.model.remember(near_);
    q_.resize(m_.n_q);
    for (auto* x : {&v_, &a_, &e_, &edot_, &demand_, &model_part_}) x->resize(m_.n);
    D_.resize(size_t(m_.n) * m_.n), C_ = D_, rho_.resize(size_t(m_.nv) * m_.n), rho_dot_ = rho_;
    Y_.resize(m_.n * law.learning.known.size()), learnt_.resize(m_.n * estimate.size());
  }

  // Whether the law reads the model at q.
  bool needs_sigma() const { return law_.kind != LawKind::pd && law_.kind != LawKind::constant; }
  // Whether it closes a model of its own.
  bool closes_itself() const { return own_ && needs_sigma(); }

  // u(t, q, q̇) at the configuration the model is closed at; false where σ(q) of a model of its own does not exist, or what is
  // learnt overflows.
  bool effort(double t, const double* q, const double* v, double* u) {
    const int n = m_.n;
    if (law_.kind == LawKind::constant) return std::copy(law_.constant.begin(), law_.constant.end(), u), true;
    if (closes_itself()) {
      if (!w_.model.sigma(q, near_)) return false;
      w_.model.remember(near_);
    }
    law_.path.at(m_, t, q_.data(), v_.data(), a_.data());
    for (const Coordinate& k : m_.coordinates) coordinate_difference(k, q + k.q, q_.data() + k.q, e_.data() + k.v);
    for (int i = 0; i < n; ++i) edot_[i] = v_[i] - v[i];
    for (int i = 0; i < n; ++i) {
      demand_[i] = 0;
      for (int k = 0; k < n; ++k) demand_[i] += law_.K_p[i * n + k] * e_[k] + law_.K_v[i * n + k] * edot_[k];
    }
    switch (law_.kind) {
      case LawKind::constant:
      case LawKind::pd: model_part_ = law_.constant; break;
      case LawKind::pd_gravity: w_.model.gravity_at_rest(model_part_.data()); break;
      case LawKind::computed_torque:
        for (int i = 0; i < n; ++i) demand_[i] += a_[i];
        w_.model.inverse(v, demand_.data(), u);
        return true;
      case LawKind::adaptive: return learn(v, u);
      case LawKind::pd_plus:
        w_.terms.matrices(v, D_.data(), C_.data(), rho_.data(), rho_dot_.data());
        w_.model.gravity(model_part_.data());
        for (int i = 0; i < n; ++i)
          for (int k = 0; k < n; ++k) model_part_[i] += D_[i * n + k] * a_[k] + C_[i * n + k] * v_[k];
        w_.model.damp(v_.data(), model_part_.data());
    }
    for (int i = 0; i < n; ++i) u[i] = demand_[i] + model_part_[i];
    return true;
  }

 private:
  Workspace& w_;
  const Mechanism& m_;
  const Law& law_;
  const bool own_;
  ClosedPoint near_;
  std::vector<double> q_, v_, a_, e_, edot_, demand_, model_part_, D_, C_, rho_, rho_dot_, Y_, learnt_;

  // One sample of an adaptive law: u, and the estimate from the next one on; false where one is not finite.
  bool learn(const double* v, double* u) {
    const Learning& l = law_.learning;
    const int n = m_.n, k = int(estimate.size()), p = int(l.known.size());
    std::vector<double>& s = demand_;
    for (int i = 0; i < n; ++i)  // q̇_r and q̈_r
      for (int j = 0; j < n; ++j) v_[i] += law_.K_p[i * n + j] * e_[j], a_[i] += law_.K_p[i * n + j] * edot_[j];
    for (int i = 0; i < n; ++i) s[i] = v[i] - v_[i];
    w_.regressor.matrix(v, a_.data(), v_.data(), Y_.data());
    std::fill(learnt_.begin(), learnt_.end(), 0.);
    for (int i = 0; i < n; ++i) {
      const double *Y = Y_.data() + size_t(i) * p, *B = l.basis.data();
      double* learnt = learnt_.data() + size_t(i) * k;
      u[i] = 0;
      for (int c = 0; c < p; ++c, B += k) {
        u[i] += Y[c] * l.known[c];
        for (int j = 0; j < k; ++j) learnt[j] += Y[c] * B[j];
      }
      for (int j = 0; j < k; ++j) u[i] += learnt[j] * estimate[j];
      for (int j = 0; j < n; ++j) u[i] -= law_.K_v[i * n + j] * s[j];
    }
    for (int j = 0; j < k; ++j) {
      double slope = 0;
      for (int i = 0; i < n; ++i) slope += learnt_[size_t(i) * k + j] * s[i];
      estimate[j] = std::min(std::max(estimate[j] - l.rates[j] * slope, l.lower[j]), l.upper[j]);
    }
    const auto finite = [](double x) { return std::isfinite(x); };
    return std::all_of(u, u + n, finite) && std::all_of(estimate.begin(), estimate.end(), finite);
  }
};

}  // namespace ccpin
