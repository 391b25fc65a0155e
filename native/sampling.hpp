// A sampled control loop, as ccpin.control.sampling has it: encoders, differentiated and filtered velocity, zero-order hold,
// saturation, delay.
#pragma once
#include "laws.hpp"

#include <deque>

namespace ccpin {

// What the loop remembers from sample to sample.
struct LoopMemory {
  std::vector<double> reading, velocity, held;
  std::deque<std::vector<double>> pending;
  double count = 0;  // of samples taken
};

struct Sampling {
  double period, gain;             // T, and 1 − e^{−2πf_cT} of the filter (1: none)
  bool differentiates;             // whether v̂ is from readings of q, or q̇ itself
  std::vector<double> resolution;  // of each encoder; empty: q̂ = q
  std::vector<double> limit;
  double start;                    // when the first sample is taken
  LoopMemory memory;
};

class SampledCommands {
 public:
  LoopMemory memory;

  SampledCommands(Workspace& w, LawRunner& law, const Sampling& sampling)
      : memory(sampling.memory), w_(w), m_(w.model.m), law_(law), s_(sampling), slope_(m_.n) {}

  double due() const { return s_.start + memory.count * s_.period; }
  // Whether the plant's model is closed at what encoders read, for the law to read it there.
  bool closes_the_plant() const { return !s_.resolution.empty() && law_.needs_sigma() && !law_.closes_itself(); }

  // Measures, filters, computes the command and holds the one that is due, with the model closed at q; false where σ of
  // the reading, or of q in a model of the law's own, does not exist. `t` is the law's time.
  bool instant(double t, const std::vector<double>& q, const double* v) {
    now_ = q;
    measure(now_);
    if (s_.differentiates)
      for (const Coordinate& k : m_.coordinates)
        coordinate_difference(k, memory.reading.data() + k.q, now_.data() + k.q, slope_.data() + k.v);
    for (int i = 0; i < m_.n; ++i) {
      double& velocity = memory.velocity[i];
      velocity = s_.differentiates ? velocity + s_.gain * (slope_[i] / s_.period - velocity) : v[i];
    }
    memory.reading = now_;
    if (closes_the_plant()) {
      w_.model.remember(near_);
      if (!w_.model.sigma(now_.data(), near_)) return false;
    }
    std::vector<double> u(m_.n);
    if (!law_.effort(t, now_.data(), memory.velocity.data(), u.data())) return false;
    for (int i = 0; i < m_.n; ++i) u[i] = std::min(std::max(u[i], -s_.limit[i]), s_.limit[i]);
    memory.pending.push_back(std::move(u));
    memory.held = std::move(memory.pending.front());
    memory.pending.pop_front();
    ++memory.count;
    return true;
  }

 private:
  Workspace& w_;
  const Mechanism& m_;
  LawRunner& law_;
  const Sampling& s_;
  std::vector<double> slope_, now_;
  ClosedPoint near_;

  void measure(std::vector<double>& q) const {  // to the nearest count; plain numbers only have encoders
    for (size_t i = 0; i < s_.resolution.size(); ++i) q[i] = std::nearbyint(q[i] / s_.resolution[i]) * s_.resolution[i];
  }
};

}  // namespace ccpin
