// The closed loop D q̈ + C q̇ + g = ρᵀJᵀw + u (22) under a law of the core, continuous or sampled, and constant wrenches, with
// samples at given times; step for step as ccpin.simulation.simulate. What is out of the ordinary (a σ that fails, a
// singularity coming near) is left to the reference: the run then gives no answer. Where it may leave its coordinates for
// others (ccpin.simulation.following) it ends there instead, with all it has.
#pragma once
#include "arrays.hpp"
#include "integrator.hpp"
#include "sampling.hpp"

#include <optional>

namespace ccpin {

struct Settling { std::vector<double> goal; double band = 0, speed = 0, hold = 0; };

// When coordinates are left: an entry of ρ, in units that the weights make comparable, is too large, or a component of a
// ball joint has turned too far from its chart's centre.
struct Leaving {
  static constexpr double kTurned = 2;  // rad
  double most = INFINITY;               // infinite: never
  std::vector<double> rows, columns;
  bool may() const { return most < INFINITY; }
};

struct Run {
  std::vector<double> times, start;   // start: (q, q̇) at the time `begin`
  double begin, first_step;           // a first step of zero: it is chosen
  double rtol, atol, longest, singular;
  Settling settling;                  // no goal: run to the end
  Pushes pushes;
  std::optional<Sampling> sampling;   // none: the law acts continuously
  Leaving leaving;
};

// Where samples go: one row each of t, q, q̇, u, q′, q̇′ and |φ|.
struct Samples {
  double *q, *v, *u, *q_free, *v_free, *closure;
  int done = 0;
};

enum class Outcome { finished, settled, interrupted, left, declined, going };

class Simulation {
 public:
  int evaluations = 0;
  double settled_since = NAN;

  Simulation(Workspace& w, const Law& law, const Run& run)
      : w_(w), m_(w.model.m), law_(w, law), run_(run), x_(run.start), t_(run.begin), stride_(run.first_step), u_(m_.motors),
        q_(m_.n_q) {
    w.model.remember(near_);
    if (run.sampling) commands_.emplace(w, law_, *run.sampling, x_.data(), x_.data() + m_.n_q);
  }

  // Where a run ended: (q, q̇), the time, the step it would have taken next, and q′.
  const std::vector<double>& state() const { return x_; }
  const std::vector<double>& place() const { return near_.q_free; }
  double time() const { return t_; }
  double stride() const { return stride_; }

  Outcome run(const Tableau& tableau, Samples& out) {
    const Outcome outcome = march(tableau, out);
    return outcome == Outcome::declined && run_.leaving.may() ? Outcome::left : outcome;
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
  double t_, stride_;                // stride: the integrator's, from leg to leg
  std::vector<double> u_, q_;
  ClosedPoint near_;
  long steps_ = 0;

  // From command to command.
  Outcome march(const Tableau& tableau, Samples& out) {
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

  // When the next sample is due.
  double pending(const Samples& out) const {
    return out.done < int(run_.times.size()) ? run_.times[out.done] : INFINITY;
  }

  // Integrates smooth equations up to `until`, sampling on the way.
  Outcome leg(const Tableau& tableau, double until, Samples& out) {
    Integrator<Simulation> solver(*this, tableau, t_, x_, until, {run_.rtol, run_.atol, run_.longest}, stride_);
    const Outcome outcome = solver.failed ? Outcome::declined : steps(solver, until, out);
    x_ = solver.y;
    return outcome;
  }
  Outcome steps(Integrator<Simulation>& solver, double until, Samples& out) {
    std::vector<double> state(x_.size());
    const double last = until - kSame * (until - t_);  // a sample due from here on is that of the next leg
    double shortened = 0;
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
      if (!close(solver.next.data()) || (singular() && !run_.leaving.may())) return Outcome::declined;
      creeping = solver.reached - t_ < kCreeping && stuck() ? creeping + 1 : 0;
      w_.model.remember(near_);
      solver.advance();
      t_ = solver.t;
      if (creeping >= kMostCreeping) return Outcome::declined;
      if (run_.leaving.may() && t_ < until && (singular() || poor())) return Outcome::left;
      if (++steps_ % 64 == 0 && interrupted()) return Outcome::interrupted;
    }
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
  bool singular() {
    return w_.model.suspicious() && w_.model.rcond() < (run_.leaving.may() ? 1 : 2) * run_.singular;
  }
  // Whether a step of less than a hundred nanoseconds may be an approach to a singularity.
  bool stuck() { return run_.leaving.may() ? run_.longest > kCreeping : w_.model.rcond() < kCreepingRcond; }

  // Whether the coordinates, at the point the model is closed at, are to be left.
  bool poor() const {
    for (size_t k = 0; k < m_.clusters.size(); ++k) {
      const Cluster& c = m_.clusters[k];
      for (int col = 0; col < c.width(); ++col)
        for (int i = 0; i < c.n(); ++i) {
          const double entry = w_.model.states[k].rho[size_t(col) * c.n() + i] * run_.leaving.rows[c.columns[col]];
          if (!(std::abs(entry) <= run_.leaving.most * run_.leaving.columns[c.independent[i]])) return true;
        }
    }
    for (const Coordinate& k : m_.coordinates)
      if (!k.whole() && k.component >= 3 && k.kind != Kind::planar &&
          rotation_vector(k, w_.model.q_free.data() + m_.joints[k.joint].q).norm() > Leaving::kTurned)
        return true;
    return false;
  }

  Outcome sample(double t, const double* state, Samples& out) {
    if (!close(state) || (singular() && !run_.leaving.may())) return Outcome::declined;
    const int k = out.done++;
    const double* v = state + m_.n_q;
    effort(t, v);
    std::copy(q_.begin(), q_.end(), out.q + size_t(k) * m_.n_q);
    std::copy(v, v + m_.n, out.v + size_t(k) * m_.n);
    std::copy(u_.begin(), u_.end(), out.u + size_t(k) * m_.motors);
    std::copy(w_.model.q_free.begin(), w_.model.q_free.end(), out.q_free + size_t(k) * m_.nq);
    free_velocity(v, out.v_free + size_t(k) * m_.nv);
    out.closure[k] = w_.model.closure();
    return settled(t, q_.data(), v) ? Outcome::settled : Outcome::going;
  }

  // q̇′ = ρ q̇.
  void free_velocity(const double* v, double* out) const {
    for (size_t k = 0; k < m_.clusters.size(); ++k) {
      const Cluster& c = m_.clusters[k];
      for (int col = 0; col < c.width(); ++col) {
        double sum = 0;
        for (int i = 0; i < c.n(); ++i) sum += w_.model.states[k].rho[size_t(col) * c.n() + i] * v[c.independent[i]];
        out[c.columns[col]] = sum;
      }
    }
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
