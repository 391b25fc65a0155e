// A sampled control loop, as ccpin.control.sampling has it: encoders, differentiated and filtered velocity, zero-order hold,
// saturation, delay. Before t = 0 the mechanism is taken to have moved steadily at q̇₀.
#pragma once
#include "laws.hpp"

#include <deque>

namespace ccpin {

struct Sampling {
  double period, gain;             // T, and 1 − e^{−2πf_cT} of the filter (1: none)
  bool differentiates;             // whether v̂ is from readings of q, or q̇ itself
  std::vector<double> resolution;  // of each encoder; empty: q̂ = q
  std::vector<double> limit, before;
  int delay;                       // whole periods
};

class SampledCommands {
 public:
  SampledCommands(Workspace& w, LawRunner& law, const Sampling& sampling, const double* q0, const double* v0)
      : w_(w), m_(w.model.m), law_(law), s_(sampling), reading_(q0, q0 + m_.n_q), velocity_(v0, v0 + m_.n), slope_(m_.n),
        pending_(sampling.delay, sampling.before), held_(sampling.before) {
    std::vector<double> back(m_.n);
    for (int i = 0; i < m_.n; ++i) back[i] = -s_.period * v0[i];
    for (const Coordinate& k : m_.coordinates) coordinate_retract(k, reading_.data() + k.q, back.data() + k.v);
    measure(reading_);
  }

  // Measures, filters, computes the command and holds the one that is due, with the model closed at q; false where σ of
  // the reading does not exist. The next instant is `next`.
  bool instant(double t, const std::vector<double>& q, const double* v) {
    now_ = q;
    measure(now_);
    if (s_.differentiates)
      for (const Coordinate& k : m_.coordinates)
        coordinate_difference(k, reading_.data() + k.q, now_.data() + k.q, slope_.data() + k.v);
    for (int i = 0; i < m_.n; ++i)
      velocity_[i] = s_.differentiates ? velocity_[i] + s_.gain * (slope_[i] / s_.period - velocity_[i]) : v[i];
    reading_ = now_;
    if (!s_.resolution.empty() && law_.needs_sigma()) {
      w_.model.remember(near_);
      if (!w_.model.sigma(reading_.data(), near_)) return false;
    }
    std::vector<double> u(m_.n);
    law_.effort(t, reading_.data(), velocity_.data(), u.data());
    for (int i = 0; i < m_.n; ++i) u[i] = std::min(std::max(u[i], -s_.limit[i]), s_.limit[i]);
    pending_.push_back(std::move(u));
    held_ = std::move(pending_.front());
    pending_.pop_front();
    next = ++count_ * s_.period;
    return true;
  }

  double next = 0;
  const std::vector<double>& held() const { return held_; }

 private:
  Workspace& w_;
  const Mechanism& m_;
  LawRunner& law_;
  const Sampling& s_;
  std::vector<double> reading_, velocity_, slope_, now_;
  std::deque<std::vector<double>> pending_;
  std::vector<double> held_;
  ClosedPoint near_;
  double count_ = 0;

  void measure(std::vector<double>& q) const {  // to the nearest count; plain numbers only have encoders
    for (size_t i = 0; i < s_.resolution.size(); ++i) q[i] = std::nearbyint(q[i] / s_.resolution[i]) * s_.resolution[i];
  }
};

}  // namespace ccpin
