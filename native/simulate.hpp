// The closed loop D q̈ + C q̇ + g = ρᵀJᵀw + u (22) under a law of the core, continuous or sampled, and constant wrenches, with
// samples at given times; step for step as ccpin.simulation.simulate. What is out of the ordinary (a σ that fails, a
// singularity coming near) is left to the reference: the run then gives no answer.
#pragma once
#include "arrays.hpp"
#include "integrator.hpp"
#include "sampling.hpp"

#include <optional>

namespace ccpin {

struct Settling { std::vector<double> goal; double band = 0, speed = 0, hold = 0; };

struct Run {
  std::vector<double> times, start;   // start: (q, q̇)
  double rtol, atol, longest, singular;
  Settling settling;                  // no goal: run to the end
  Pushes pushes;
  std::optional<Sampling> sampling;   // none: the law acts continuously
};

// Where samples go: one row each of t, q, q̇, u, q′ and |φ|.
struct Samples {
  double *q, *v, *u, *q_free, *closure;
  int done = 0;
};

enum class Outcome { finished, settled, interrupted, declined, going };

class Simulation {
 public:
  int evaluations = 0;
  double settled_since = NAN;

  Simulation(Workspace& w, const Law& law, const Run& run)
      : w_(w), m_(w.model.m), law_(w, law), run_(run), x_(run.start), u_(m_.n), q_(m_.n_q) {
    w.model.remember(near_);
    if (run.sampling) commands_.emplace(w, law_, *run.sampling, x_.data(), x_.data() + m_.n_q);
  }

  // From command to command.
  Outcome run(const Tableau& tableau, Samples& out) {
    const double end = run_.times.back();
    for (;;) {
      double until = end;
      if (commands_) {
        if (!close(x_.data()) || !commands_->instant(t_, q_, x_.data() + m_.n_q)) return Outcome::declined;
        if (commands_->next < end - kSame * (commands_->next - t_)) until = commands_->next;
      }
      for (const double here = t_ + kSame * (until - t_); pending(out) <= here;)
        if (const Outcome o = sample(pending(out), x_.data(), out); o != Outcome::going) return o;
      if (t_ >= end) return Outcome::finished;
      if (const Outcome o = leg(tableau, until, out); o != Outcome::going) return o;
    }
  }

  // The right-hand side (q̇, q̈); false where σ or q̈ does not exist.
  bool operator()(double t, const double* state, double* rate) {
    ++evaluations;
    if (!close(state)) return false;
    const double* v = state + m_.n_q;
    effort(t, v);
    for (const Coordinate& k : m_.coordinates) coordinate_rate(k, q_.data() + k.q, v + k.v, rate + k.q);
    return w_.model.forward(v, u_.data(), rate + m_.n_q, run_.pushes);
  }

 private:
  static constexpr double kSame = 1e-9;  // of the time between two commands
  static constexpr double kCreeping = 1e-7, kCreepingRcond = 1e-3, kShortest = 1e-10;
  static constexpr int kMostCreeping = 200;
  Workspace& w_;
  const Mechanism& m_;
  LawRunner law_;
  const Run& run_;
  std::optional<SampledCommands> commands_;
  std::vector<double> x_;            // (q, q̇) at t_
  double t_ = 0, stride_ = 0;        // stride: the integrator's, from leg to leg
  std::vector<double> u_, q_;
  ClosedPoint near_;
  long steps_ = 0;

  // When the next sample is due.
  double pending(const Samples& out) const {
    return out.done < int(run_.times.size()) ? run_.times[out.done] : INFINITY;
  }

  // Integrates smooth equations up to `until`, sampling on the way.
  Outcome leg(const Tableau& tableau, double until, Samples& out) {
    Integrator<Simulation> solver(*this, tableau, t_, x_, until, {run_.rtol, run_.atol, run_.longest}, stride_);
    std::vector<double> state(x_.size());
    const double last = until - kSame * (until - t_);  // a sample due from here on is that of the next leg
    double shortened = 0;
    if (solver.failed) return Outcome::declined;
    for (int creeping = 0; t_ < until;) {
      if (!solver.step()) {  // σ fails at a trial: again, a quarter as far
        shortened = 0.25 * (shortened > 0 ? shortened : std::min(solver.h, until - t_));
        if (solver.failed || shortened < kShortest || !solver.restart(shortened)) return Outcome::declined;
        continue;
      }
      shortened = 0, stride_ = solver.h;
      for (double time; (time = pending(out)) <= solver.reached && time < last;) {
        const bool exact = time == solver.reached;
        if (!exact && !solver.interpolate(time, state.data())) return Outcome::declined;
        const Outcome o = sample(time, exact ? solver.next.data() : state.data(), out);
        if (o != Outcome::going) return o;
      }
      if (!close(solver.next.data()) || singular()) return Outcome::declined;
      creeping = solver.reached - t_ < kCreeping && w_.model.rcond() < kCreepingRcond ? creeping + 1 : 0;
      if (creeping >= kMostCreeping) return Outcome::declined;
      w_.model.remember(near_);
      solver.advance();
      t_ = solver.t;
      if (++steps_ % 64 == 0 && interrupted()) return Outcome::interrupted;
    }
    x_ = solver.y;
    return Outcome::going;
  }

  void effort(double t, const double* v) {
    if (commands_) u_ = commands_->held();
    else law_.effort(t, q_.data(), v, u_.data());
  }

  bool close(const double* state) {
    q_.assign(state, state + m_.n_q);
    for (const Coordinate& k : m_.coordinates) {
      const UnitWindow unit = k.whole() ? unit_window(k.kind) : UnitWindow{0, 0};
      if (unit.size) Eigen::Map<Eigen::VectorXd>(q_.data() + k.q + unit.start, unit.size).normalize();
    }
    return w_.model.sigma(q_.data(), near_);
  }
  bool singular() { return w_.model.suspicious() && w_.model.rcond() < 2 * run_.singular; }

  Outcome sample(double t, const double* state, Samples& out) {
    if (!close(state) || singular()) return Outcome::declined;
    const int k = out.done++;
    const double* v = state + m_.n_q;
    effort(t, v);
    std::copy(q_.begin(), q_.end(), out.q + size_t(k) * m_.n_q);
    std::copy(v, v + m_.n, out.v + size_t(k) * m_.n);
    std::copy(u_.begin(), u_.end(), out.u + size_t(k) * m_.n);
    std::copy(w_.model.q_free.begin(), w_.model.q_free.end(), out.q_free + size_t(k) * m_.nq);
    out.closure[k] = w_.model.closure();
    return settled(t, q_.data(), v) ? Outcome::settled : Outcome::going;
  }

  // Whether a sample ends a stay of `hold` seconds within the band.
  bool settled(double t, const double* q, const double* v) {
    if (run_.settling.goal.empty()) return false;
    double step[6], error = 0, speed = 0;
    for (const Coordinate& k : m_.coordinates) {
      coordinate_difference(k, q + k.q, run_.settling.goal.data() + k.q, step);
      for (int i = 0; i < k.nv; ++i) error = std::max(error, std::abs(step[i]));
    }
    for (int i = 0; i < m_.n; ++i) speed = std::max(speed, std::abs(v[i]));
    if (error > run_.settling.band || speed > run_.settling.speed) settled_since = NAN;
    else if (std::isnan(settled_since)) settled_since = t;
    return t - settled_since >= run_.settling.hold * (1 - 1e-12);
  }

  static bool interrupted() {
    nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() == 0) return false;
    PyErr_Clear();
    return true;
  }
};

}  // namespace ccpin
