// SciPy's RK45 and DOP853, step for step: the coefficients come from SciPy, the step control and the interpolants are
// those of scipy.integrate._ivp (Dormand and Prince 5(4) with Shampine's interpolant; Hairer, Nørsett and Wanner,
// Solving Ordinary Differential Equations I, 8(5,3) with an interpolant of order 7).
#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

namespace ccpin {

struct Tableau {
  int stages = 0, extra = 0, error_order = 0;
  std::vector<double> A, B, C;   // A: (stages + 1 + extra) × columns; rows beyond the stages make the interpolant
  std::vector<double> E, E_low;  // the error estimate; DOP853 has a second one of lower order
  std::vector<double> P;         // RK45: (stages + 1) × 4; DOP853: 4 × (stages + 1 + extra)
  int columns = 0;
  bool eighth() const { return !E_low.empty(); }
};

template <class F> class Integrator {
 public:
  std::vector<double> y, next;
  double t = 0, h = 0;
  bool failed = false;  // the right-hand side is not defined at the start, or the step became too short

  Integrator(F& f, const Tableau& tableau, size_t size, double rtol, double atol, double longest)
      : y(size), next(size), f_(f), T_(tableau), rtol_(rtol), atol_(atol), longest_(longest), size_(size) {
    trial_ = scale_ = y;
    k_.assign(T_.stages + 1 + T_.extra, std::vector<double>(size_));
  }

  // Go on from `y` at `t` to an end, where the equations may be others than before; `first` 0: a first step of one's own.
  bool begin(double end, double first = 0) {
    end_ = end, reached = t, taken_ = 0, prepared_ = false;
    failed = !f_(t, y.data(), k_[0].data());
    if (!failed) h = first > 0 ? std::min({first, end - t, longest_}) : first_step();
    return !failed;
  }
  const double* slope() const { return k_[0].data(); }  // after `begin` or `advance`: the right-hand side at `y`

  // One accepted step, to `reached`; `advance` makes it the current state. False, and h as it was, where the right-hand
  // side is not defined at a trial; `failed` as well where the step became too short.
  double reached = 0;
  bool step() {
    const double shortest = 10 * (std::nextafter(t, INFINITY) - t), exponent = -1. / (T_.error_order + 1);
    bool rejected = false;
    double trial = std::min(std::max(h, shortest), longest_);
    for (;;) {
      if (!(trial >= shortest)) return !(failed = true);  // NaN too, from states beyond what numbers hold
      reached = std::min(t + trial, end_);
      taken_ = trial = reached - t;
      if (!stages()) return false;
      for (size_t i = 0; i < size_; ++i) scale_[i] = atol_ + rtol_ * std::max(std::abs(y[i]), std::abs(next[i]));
      const double e = error();
      if (e < 1) {
        const double factor = e == 0 ? 10 : std::min(10., 0.9 * std::pow(e, exponent));
        h = trial * (rejected ? std::min(1., factor) : factor);
        prepared_ = false;
        return true;
      }
      trial *= std::max(0.2, 0.9 * std::pow(e, exponent));
      rejected = true;
    }
  }
  bool restart(double first) {  // from the current state with a given first step
    h = first;
    return f_(t, y.data(), k_[0].data());
  }
  void advance() {
    t = reached;
    std::swap(y, next);
    std::swap(k_[0], k_[T_.stages]);
  }

  // In place of `advance`: what the last step comes to at an earlier time; `begin` is next.
  void cut(double time, const std::vector<double>& there) { t = time, y = there; }

  // The state at a time within the last step, before `advance`.
  bool interpolate(double time, double* out) {
    if (!prepared_ && !prepare()) return !(failed = true);
    const double x = (time - t) / taken_;
    for (size_t i = 0; i < size_; ++i) {
      const double* c = &dense_[i * width()];
      double sum = 0;
      if (T_.eighth())
        for (int p = 6; p >= 0; --p) sum = (sum + c[p]) * ((6 - p) % 2 == 0 ? x : 1 - x);
      else
        sum = taken_ * x * (c[0] + x * (c[1] + x * (c[2] + x * c[3])));
      out[i] = y[i] + sum;
    }
    return true;
  }

 private:
  F& f_;
  const Tableau& T_;
  double end_ = 0, rtol_, atol_, longest_, taken_ = 0;
  size_t size_;
  bool prepared_ = false;
  std::vector<double> trial_, scale_, dense_;
  std::vector<std::vector<double>> k_;

  int width() const { return T_.eighth() ? 7 : 4; }
  double norm(const std::vector<double>& x) const {
    double sum = 0;
    for (size_t i = 0; i < size_; ++i) sum += (x[i] / scale_[i]) * (x[i] / scale_[i]);
    return std::sqrt(sum / size_);
  }
  double combine(const double* weights, int count, size_t i) const {
    double sum = 0;
    for (int j = 0; j < count; ++j) sum += weights[j] * k_[j][i];
    return sum;
  }

  double first_step() {
    const double interval = end_ - t;
    for (size_t i = 0; i < size_; ++i) scale_[i] = atol_ + rtol_ * std::abs(y[i]);
    const double d0 = norm(y), d1 = norm(k_[0]);
    const double h0 = std::min(d0 < 1e-5 || d1 < 1e-5 ? 1e-6 : 0.01 * d0 / d1, interval);
    for (size_t i = 0; i < size_; ++i) trial_[i] = y[i] + h0 * k_[0][i];
    std::vector<double> f1(size_);
    failed = !f_(t + h0, trial_.data(), f1.data());
    for (size_t i = 0; i < size_; ++i) f1[i] -= k_[0][i];
    const double d2 = norm(f1) / h0;
    const double h1 = d1 <= 1e-15 && d2 <= 1e-15 ? std::max(1e-6, h0 * 1e-3)
                                                : std::pow(0.01 / std::max(d1, d2), 1. / (T_.error_order + 1));
    return std::min({100 * h0, h1, interval, longest_});
  }

  bool stage(int s, int row) {
    for (size_t i = 0; i < size_; ++i) trial_[i] = y[i] + taken_ * combine(&T_.A[row * T_.columns], s, i);
    return f_(t + T_.C[row] * taken_, trial_.data(), k_[s].data());
  }
  bool stages() {
    for (int s = 1; s < T_.stages; ++s)
      if (!stage(s, s)) return false;
    for (size_t i = 0; i < size_; ++i) next[i] = y[i] + taken_ * combine(T_.B.data(), T_.stages, i);
    return f_(t + taken_, next.data(), k_[T_.stages].data());
  }

  double error() const {
    double high = 0, low = 0;
    for (size_t i = 0; i < size_; ++i) {
      high += std::pow(combine(T_.E.data(), T_.stages + 1, i) / scale_[i], 2);
      if (T_.eighth()) low += std::pow(combine(T_.E_low.data(), T_.stages + 1, i) / scale_[i], 2);
    }
    if (!T_.eighth()) return taken_ * std::sqrt(high / size_);
    return high == 0 && low == 0 ? 0 : taken_ * high / std::sqrt((high + 0.01 * low) * size_);
  }

  bool prepare() {
    dense_.resize(size_ * width());
    for (int s = T_.stages + 1; s <= T_.stages + T_.extra; ++s)
      if (!stage(s, s)) return false;
    for (size_t i = 0; i < size_; ++i) {
      double* c = &dense_[i * width()];
      if (T_.eighth()) {
        const double dy = next[i] - y[i], f0 = k_[0][i], f1 = k_[T_.stages][i];
        c[0] = dy, c[1] = taken_ * f0 - dy, c[2] = 2 * dy - taken_ * (f1 + f0);
        const int count = T_.stages + 1 + T_.extra;
        for (int p = 0; p < 4; ++p) c[3 + p] = taken_ * combine(&T_.P[size_t(p) * count], count, i);
      } else {
        for (int p = 0; p < 4; ++p) {
          c[p] = 0;
          for (int j = 0; j <= T_.stages; ++j) c[p] += k_[j][i] * T_.P[j * 4 + p];
        }
      }
    }
    return prepared_ = true;
  }
};

}  // namespace ccpin
