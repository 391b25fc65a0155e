// The closed loop D q̈ + C q̇ + g = ρᵀJᵀw + u (22) under a law of the core, continuous or sampled, and constant wrenches, with
// samples at given times, and steps of it with u held; step for step as ccpin.simulation.run. What is out of the ordinary
// (a σ that fails, a singularity coming near) is left to the reference: there is no answer.
#pragma once
#include "arrays.hpp"
#include "integrator.hpp"
#include "sampling.hpp"

#include <chrono>
#include <optional>

namespace ccpin {

struct Settling { std::vector<double> goal; double band = 0, speed = 0, hold = 0; };

struct Run {
  std::vector<double> times, start;   // times: of the samples, from where it begins; start: (q, q̇)
  double origin = 0;                  // when the law's clock shows 0
  double rtol = 0, atol = 0, longest = 0, singular = 0;
  double evaluations = 0, seconds = 0;  // the budget
  std::vector<double> lower, upper;   // of u; a run that would go beyond is the reference's
  Settling settling;                  // no goal: run to the end
  Pushes pushes;
  std::optional<Sampling> sampling;   // none: the law acts continuously
};

// Where samples go: one row each of t, q, q̇, q̈, u, q′ and |φ|.
struct Samples {
  double *t, *q, *v, *a, *u, *q_free, *closure;
  int done = 0;
};

enum class Outcome { finished, settled, exhausted_evaluations, exhausted_seconds, interrupted, declined };

// Closes the model along the states that an integrator asks for, from the last one accepted.
class Follower {
 public:
  Follower(Workspace& w, double singular, const Pushes& pushes)
      : w_(w), m_(w.model.m), singular_(singular), pushes_(pushes), q_(m_.n_q) {}

  bool close(const double* state) {
    q_.assign(state, state + m_.n_q);
    for (const Coordinate& k : m_.coordinates) {
      const UnitWindow unit = k.whole() ? unit_window(k.kind) : UnitWindow{0, 0};
      if (unit.size) Eigen::Map<Eigen::VectorXd>(q_.data() + k.q + unit.start, unit.size).normalize();
    }
    return w_.model.sigma(q_.data(), near_);
  }
  // (q̇, q̈) at the configuration the model is closed at.
  bool rates(const double* v, const double* u, double* rate) {
    for (const Coordinate& k : m_.coordinates) coordinate_rate(k, q_.data() + k.q, v + k.v, rate + k.q);
    return w_.model.forward(v, u, rate + m_.n_q, pushes_);
  }
  // The step just taken counts; false where the next ones may be out of the ordinary.
  bool accept(const double* state, double length) {
    if (!close(state) || (w_.model.suspicious() && w_.model.rcond() < 2 * singular_)) return false;
    creeping_ = length < kCreeping && w_.model.rcond() < kCreepingRcond ? creeping_ + 1 : 0;
    w_.model.remember(near_);
    return creeping_ < kMostCreeping;
  }
  void start_here() { w_.model.remember(near_), creeping_ = 0; }

 protected:
  static constexpr double kCreeping = 1e-7, kCreepingRcond = 1e-3, kShortest = 1e-10;
  static constexpr int kMostCreeping = 200;
  Workspace& w_;
  const Mechanism& m_;
  double singular_;
  const Pushes pushes_;
  std::vector<double> q_;
  ClosedPoint near_;

 private:
  int creeping_ = 0;
};

// A step of the integrator, again a quarter as far where σ fails at a trial; false where that does not help.
template <class Solver> bool robust_step(Solver& solver, double end, double shortest) {
  for (double shortened = 0;;) {
    if (solver.step()) return true;
    shortened = 0.25 * (shortened > 0 ? shortened : std::min(solver.h, end - solver.t));
    if (solver.failed || shortened < shortest || !solver.restart(shortened)) return false;
  }
}

inline double slack(double t) { return 16 * (std::nextafter(std::abs(t), INFINITY) - std::abs(t)); }

class Simulation : public Follower {
  using Solver = Integrator<Simulation>;

 public:
  int evaluations = 0;
  double settled_since = NAN;
  PyObject* raised = nullptr;  // by a signal's handler

  Simulation(Workspace& w, const Law& law, const Run& run)
      : Follower(w, run.singular, run.pushes), law_(w, law), path_(law.path), run_(run), u_(m_.n) {
    start_here();
    if (run.sampling) commands_.emplace(w, law_, *run.sampling);
  }
  const std::optional<SampledCommands>& commands() const { return commands_; }

  Outcome run(const Tableau& tableau, Samples& out) {
    const auto began = std::chrono::steady_clock::now();
    const auto seconds = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count(); };
    const double end = run_.times.back();
    Solver solver(*this, tableau, run_.start.size(), run_.rtol, run_.atol, run_.longest);
    solver.y = run_.start, solver.t = run_.times[0];
    state_.resize(run_.start.size());
    if (settles() && excess(solver.y.data()) <= 0) settled_since = solver.t;
    double stride = 0;  // the integrator's, from leg to leg; 0: to be chosen
    for (int steps = 1;;) {
      if (commands_ && solver.t >= commands_->due() - slack(commands_->due())) {
        const double* v = solver.y.data() + m_.n_q;
        if (!close(solver.y.data()) || !commands_->instant(clock(solver.t), q_, v)) return Outcome::declined;
      }
      if (due(out, solver.t + slack(solver.t)) && !sample(run_.times[out.done], solver.y.data(), out))
        return Outcome::declined;
      if (solver.t >= end) return Outcome::finished;
      const double change = commands_ ? INFINITY : next_piece(solver.t), until = commands_ ? std::min(commands_->due(), end) : end;
      bool changes = change < until - slack(until);
      double leg = changes ? change : until;
      if (stride == 0 && solver.t + run_.longest < leg) leg = solver.t + run_.longest, changes = false;
      if (!solver.begin(leg, stride)) return Outcome::declined;
      for (; solver.t < leg; ++steps) {
        if (!robust_step(solver, leg, kShortest)) return Outcome::declined;
        double halt = NAN;
        if (settles() && !look(solver, halt)) return Outcome::declined;
        const bool settled = !std::isnan(halt);
        const double reached = settled ? halt : solver.reached;
        while (due(out, std::min(reached, leg - 2 * slack(leg)))) {
          const double time = run_.times[out.done];
          if (!solver.interpolate(time, state_.data()) || !sample(time, state_.data(), out)) return Outcome::declined;
        }
        state_ = solver.next;
        if (reached < solver.reached && !solver.interpolate(reached, state_.data())) return Outcome::declined;
        if (!accept(state_.data(), reached - solver.t)) return Outcome::declined;
        const bool spent = evaluations >= run_.evaluations, late = std::isfinite(run_.seconds) && seconds() >= run_.seconds;
        const bool stopped = steps % 64 == 0 && interrupted();
        if (settled || spent || late || stopped) {
          if (out.t[out.done - 1] < reached - slack(reached) && !sample(reached, state_.data(), out))
            return Outcome::declined;
          return settled   ? Outcome::settled
                 : spent   ? Outcome::exhausted_evaluations
                 : late    ? Outcome::exhausted_seconds
                           : Outcome::interrupted;
        }
        solver.advance();
      }
      stride = changes ? 0 : solver.h;
    }
  }

  // The right-hand side (q̇, q̈); false where σ or q̈ does not exist.
  bool operator()(double t, const double* state, double* rate) {
    ++evaluations;
    if (!close(state)) return false;
    const double* v = state + m_.n_q;
    return effort(t, v) && rates(v, u_.data(), rate);
  }

 private:
  static constexpr int kParts = 8;
  struct Crossing { double t; bool inside; };
  LawRunner law_;
  const Path& path_;
  const Run& run_;
  std::optional<SampledCommands> commands_;
  std::vector<double> u_, state_;
  std::vector<Crossing> crossings_;

  bool due(const Samples& out, double until) const {
    return out.done < int(run_.times.size()) && run_.times[out.done] <= until;
  }
  // What the law's clock shows; a break that is not later than t on the clock outside is not later there.
  double clock(double t) const {
    const double inside = t - run_.origin;
    const auto next = std::upper_bound(path_.breaks.begin(), path_.breaks.end(), inside);
    return next != path_.breaks.end() && *next + run_.origin <= t ? *next : inside;
  }
  // When the path passes to its next piece.
  double next_piece(double t) const {
    const auto next = std::upper_bound(path_.breaks.begin(), path_.breaks.end(), clock(t));
    return next == path_.breaks.end() ? INFINITY : *next + run_.origin;
  }

  // The law's efforts; false where motors cannot give them.
  bool effort(double t, const double* v) {
    if (commands_) u_ = commands_->memory.held;
    else law_.effort(clock(t), q_.data(), v, u_.data());
    for (size_t i = 0; i < u_.size(); ++i)
      if (u_[i] < run_.lower[i] || u_[i] > run_.upper[i]) return false;
    return true;
  }

  bool sample(double t, const double* state, Samples& out) {
    if (!close(state) || (w_.model.suspicious() && w_.model.rcond() < 2 * singular_)) return false;
    const int k = out.done++;
    const double* v = state + m_.n_q;
    if (!effort(t, v)) return false;
    out.t[k] = t;
    std::copy(q_.begin(), q_.end(), out.q + size_t(k) * m_.n_q);
    std::copy(v, v + m_.n, out.v + size_t(k) * m_.n);
    std::copy(u_.begin(), u_.end(), out.u + size_t(k) * m_.n);
    std::copy(w_.model.q_free.begin(), w_.model.q_free.end(), out.q_free + size_t(k) * m_.nq);
    out.closure[k] = w_.model.closure();
    return w_.model.forward(v, u_.data(), out.a + size_t(k) * m_.n, pushes_);
  }

  // Settling, as ccpin.simulation.settling.
  bool settles() const { return !run_.settling.goal.empty(); }
  double excess(const double* state) const {
    double step[6], error = 0, speed = 0;
    for (const Coordinate& k : m_.coordinates) {
      coordinate_difference(k, state + k.q, run_.settling.goal.data() + k.q, step);
      for (int i = 0; i < k.nv; ++i) error = std::max(error, std::abs(step[i]));
    }
    for (int i = 0; i < m_.n; ++i) speed = std::max(speed, std::abs(state[m_.n_q + i]));
    return std::max(error / run_.settling.band, speed / run_.settling.speed) - 1;
  }
  bool inside(Solver& solver, double t, bool& found) {
    if (!solver.interpolate(t, state_.data())) return false;
    found = excess(state_.data()) <= 0;
    return true;
  }
  // Where in the step just tried the band is entered and left, and when the motion has settled; false: no answer.
  bool look(Solver& solver, double& halt) {
    double since = settled_since, before = solver.t;
    crossings_.clear();
    for (int part = 1; part <= kParts; ++part) {
      const double after = part == kParts ? solver.reached : solver.t + part * (solver.reached - solver.t) / kParts;
      bool now, was;
      if (!inside(solver, after, now)) return false;
      if (now == std::isnan(since)) {
        double low = before, high = after;
        if (!inside(solver, before, was)) return false;
        while (was != now && high - low > std::max(1e-13, slack(high) / 4)) {
          const double middle = low + 0.5 * (high - low);
          bool there;
          if (!inside(solver, middle, there)) return false;
          (there == now ? high : low) = middle;
        }
        const double crossing = was == now ? before : high;
        if (!now && crossing - since >= run_.settling.hold) break;
        since = now ? crossing : NAN;
        crossings_.push_back({crossing, now});
      }
      before = after;
    }
    if (!std::isnan(since) && since + run_.settling.hold <= solver.reached)
      halt = std::max(since + run_.settling.hold, solver.t);
    for (const Crossing& crossing : crossings_)
      if (std::isnan(halt) || crossing.t <= halt) settled_since = crossing.inside ? crossing.t : NAN;
    return true;
  }

  bool interrupted() {
    nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() == 0) return false;
    PyObject *type, *trace;
    PyErr_Fetch(&type, &raised, &trace);
    PyErr_NormalizeException(&type, &raised, &trace);
    Py_XDECREF(type), Py_XDECREF(trace);
    return true;
  }
};

// A motion that is stepped with u held.
class Stepper : public Follower {
 public:
  int evaluations = 0;
  double last_step = 0;  // what the integrator would try next

  Stepper(Workspace& w, const Tableau& tableau, double rtol, double atol, double longest, double singular,
          const Pushes& pushes)
      : Follower(w, singular, pushes), tableau_(tableau), solver_(*this, tableau_, m_.n_q + m_.n, rtol, atol, longest) {}

  // Begin where the model is closed.
  void start(const double* q, const double* v, double first) {
    std::copy(q, q + m_.n_q, solver_.y.data()), std::copy(v, v + m_.n, solver_.y.data() + m_.n_q);
    last_step = first;
    start_here();
  }
  // `state` and `acceleration` then tell; false: no answer, and no place to go on from.
  bool step(const double* u, double dt) {
    u_ = u, solver_.t = 0;
    if (!solver_.begin(dt, last_step)) return false;
    while (solver_.t < dt) {
      if (!robust_step(solver_, dt, kShortest) || !accept(solver_.next.data(), solver_.reached - solver_.t)) return false;
      solver_.advance();
    }
    last_step = solver_.h;
    return true;
  }
  const double* state() const { return solver_.y.data(); }
  const double* acceleration() const { return solver_.slope() + m_.n_q; }

  bool operator()(double, const double* state, double* rate) {
    ++evaluations;
    return close(state) && rates(state + m_.n_q, u_, rate);
  }

 private:
  const Tableau tableau_;
  Integrator<Stepper> solver_;
  const double* u_ = nullptr;
};

}  // namespace ccpin
