// The closed loop D q̈ + C q̇ + g = ρᵀ(Jᵀw + f) + u (22) under a law of the core, continuous or sampled, constant wrenches and
// dry friction f, with samples at given times, and steps of it with u held; step for step as
// ccpin.simulation.integration.run, the instants at which joints halt and break loose included. What is out of
// the ordinary (a σ that fails, a singularity coming near) is left to the reference: there is no answer. A run that may
// leave its coordinates for others (ccpin.simulation.integration.coordinate_switching) ends there instead, at its last
// certain step.
#pragma once
#include "arrays.hpp"
#include "integrator.hpp"
#include "sampling.hpp"
#include "stick_slip.hpp"

#include <chrono>
#include <deque>
#include <optional>

namespace ccpin {

struct Settling { std::vector<double> goal; double band = 0, speed = 0, hold = 0; };

// When coordinates are left: an entry of ρ, in units that the weights make comparable, is too large, or a joint with
// single turns for coordinates is too far from its chart's centre.
struct Leaving {
  double most = INFINITY, turn = INFINITY;  // most infinite: never
  std::vector<double> rows, columns;
  bool may() const { return most < INFINITY; }

  // Whether they are, at the point a model is closed at.
  bool poor(const ReducedModel& model) const {
    const Mechanism& m = model.m;
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      const double* rho = model.states[k].rho.data();
      for (int col = 0; col < c.width(); ++col)
        for (int i = 0; i < c.n(); ++i, ++rho)
          if (!(std::abs(*rho) * rows[c.columns[col]] <= most * columns[c.independent[i]])) return true;
    }
    for (const Coordinate& k : m.coordinates)
      if (k.component >= 3 && k.kind != Kind::planar &&
          rotation_vector(k, model.q_free.data() + m.joints[k.joint].q).norm() > turn)
        return true;
    return false;
  }
};

struct Run {
  std::vector<double> times, start;   // times: of the samples; start: (q, q̇)
  double begin = 0, until = 0;        // when it begins and ends
  double stride = 0;                  // its first step; 0: to be chosen
  Leaving leaving;
  double origin = 0;                  // when the law's clock shows 0
  double rtol = 0, atol = 0, longest = 0, singular = 0;
  double evaluations = 0, seconds = 0;  // the budget
  std::vector<double> lower, upper;   // of u; a run that would go beyond is the reference's
  Settling settling;                  // no goal: run to the end
  Pushes pushes;
  std::optional<Sampling> sampling;   // none: the law acts continuously
  std::optional<Friction> friction;   // none: no joint rubs
};

// Where samples go: one row each of t, q, q̇, q̈, u, q′, q̇′, f and |φ|; of runs that may leave their coordinates also q̈′.
struct Samples {
  double *t, *q, *v, *a, *u, *q_free, *v_free, *friction, *closure, *a_free;
  int done = 0;
};

enum class Outcome { finished, settled, exhausted_evaluations, exhausted_seconds, interrupted, left, declined };

// Closes the model along the states that an integrator asks for, from the last one accepted.
class Follower {
 public:
  Follower(Workspace& w, double singular, double longest, const Pushes& pushes, const Leaving& leaving)
      : w_(w), m_(w.model.m), leaving_(leaving), singular_(singular), longest_(longest), pushes_(pushes), q_(m_.n_q) {}

  // Where it is closed already it is not closed again.
  bool close(const double* state) {
    q_.assign(state, state + m_.n_q);
    for (const Coordinate& k : m_.coordinates) {
      const UnitWindow unit = k.whole() ? unit_window(k.kind) : UnitWindow{0, 0};
      if (unit.size) Eigen::Map<Eigen::VectorXd>(q_.data() + k.q + unit.start, unit.size).normalize();
    }
    if (q_ == closed_) return true;
    closed_.clear();
    if (!w_.model.sigma(q_.data(), near_)) return false;
    return closed_ = q_, true;
  }
  // d/dt of the numbers in q, at the configuration the model is closed at.
  void coordinate_rates(const double* v, double* rate) const {
    for (const Coordinate& k : m_.coordinates) coordinate_rate(k, q_.data() + k.q, v + k.v, rate + k.q);
  }
  // That and q̈.
  bool rates(const double* v, const double* u, double* rate) {
    coordinate_rates(v, rate);
    return w_.model.forward(v, u, rate + m_.n_q, pushes_);
  }
  // The step just taken counts; false where the next ones may be out of the ordinary.
  bool accept(const double* state, double length) {
    if (!close(state) || (w_.model.suspicious() && w_.model.rcond() < 2 * singular_)) return false;
    const bool stuck = leaving_.may() ? longest_ > kCreeping : w_.model.rcond() < kCreepingRcond;
    creeping_ = length < kCreeping && stuck ? creeping_ + 1 : 0;
    w_.model.remember(near_, true);
    return leaving_.may() || creeping_ < kMostCreeping;
  }
  // Whether the coordinates are to be left at the step just accepted.
  bool poor() const { return leaving_.may() && (creeping_ >= kMostCreeping || leaving_.poor(w_.model)); }
  int creeping() const { return creeping_; }  // how many steps in a row were next to nothing
  void start_here() { w_.model.remember(near_, true), closed_.clear(), creeping_ = 0; }

 protected:
  static constexpr double kCreeping = 1e-7, kCreepingRcond = 1e-3, kShortest = 1e-10;
  static constexpr int kMostCreeping = 200;
  Workspace& w_;
  const Mechanism& m_;
  Leaving leaving_;
  double singular_, longest_;
  const Pushes pushes_;
  std::vector<double> q_;
  ClosedPoint near_;

  void closed_elsewhere() { closed_.clear(); }  // by others, since

 private:
  std::vector<double> closed_;  // q; empty: not known
  int creeping_ = 0;
};

// A step of the integrator, again a quarter as far where σ fails at a trial; false where that does not help.
template <class Solver> bool robust_step(Solver& solver, double end, double shortest) {
  for (double shortened = 0;;) {
    if (solver.step()) return true;
    shortened = 0.25 * (shortened > 0 ? shortened : std::min(solver.h, end - solver.t));
    if (solver.failed || !(shortened >= shortest) || !solver.restart(shortened)) return false;
  }
}

inline double slack(double t) { return 16 * (std::nextafter(std::abs(t), INFINITY) - std::abs(t)); }

// Looks for Ctrl-C in a computation that has let the interpreter go.
class Signals {
 public:
  PyObject* raised = nullptr;  // by a signal's handler

  bool arrived() {
    nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() == 0) return false;
    PyObject *type, *trace;
    PyErr_Fetch(&type, &raised, &trace);
    PyErr_NormalizeException(&type, &raised, &trace);
    Py_XDECREF(type), Py_XDECREF(trace);
    return true;
  }
};

class Simulation : public Follower {
  using Solver = Integrator<Simulation>;

 public:
  int evaluations = 0;
  double settled_since = NAN;
  Signals signals;

  // `own`: the workspace of the law's model, closed where the run begins; the plant's where that is its model.
  Simulation(Workspace& w, Workspace& own, const Law& law, const Run& run, const Tableau& tableau)
      : Follower(w, run.singular, run.longest, run.pushes, run.leaving), law_(own, law, &own != &w), path_(law.path), run_(run),
        solver_(*this, tableau, run.start.size(), run.rtol, run.atol, run.longest), stages_(tableau.stages),
        stride_(run.stride), u_(m_.motors), state_(run.start) {
    solver_.y = run.start, solver_.t = run.begin;
    start_here();
    if (run.sampling) commands_.emplace(w, law_, *run.sampling);
    if (run.friction) contact_.emplace(w, *run.friction);
  }
  const std::optional<SampledCommands>& commands() const { return commands_; }
  const std::optional<StickSlip>& contact() const { return contact_; }
  const std::vector<double>& estimate() const { return law_.estimate; }

  // Where the run has come to: the time, (q, q̇), q′ and the step it would take next (0: to be chosen).
  double time() const { return solver_.t; }
  const std::vector<double>& state() const { return solver_.y; }
  const std::vector<double>& place() const { return near_.q_free; }
  double stride() const { return stride_; }

  Outcome run(Samples& out) {
    const Outcome outcome = march(out);
    if (outcome != Outcome::declined || !leaving_.may()) return outcome;
    out.done = certain_;
    return Outcome::left;
  }

  // The right-hand side (q̇, q̈); false where σ or q̈ does not exist.
  bool operator()(double t, const double* state, double* rate) {
    ++evaluations;
    if (!close(state)) return false;
    const double* v = state + m_.n_q;
    if (!effort(t, v)) return false;
    if (!within_bounds()) beyond_ = evaluations;
    if (!contact_) return rates(v, u_.data(), rate);
    coordinate_rates(v, rate);
    return contact_->acceleration(v, u_.data(), rate + m_.n_q, pushes_);
  }

 private:
  static constexpr int kParts = 8, kContactParts = 4;  // of a step, at whose ends one looks for settling, and for friction
  static constexpr int kMostEvents = 200;              // within a microsecond: then they have no end
  static constexpr double kWidth = 1e-10;              // s, to which the time of one is found,
  static constexpr double kSharp = 1e-12;              // and between which times guesses leave it,
  static constexpr int kGuesses = 12;                  // so many at most
  struct Crossing { double t; bool inside; };
  LawRunner law_;
  const Path& path_;
  const Run& run_;
  std::optional<SampledCommands> commands_;
  std::optional<StickSlip> contact_;
  std::deque<double> recent_;  // when joints halted or broke loose
  Solver solver_;
  int stages_, beyond_ = 0;  // beyond_: the last evaluation with efforts that motors cannot give
  double stride_;            // from leg to leg
  int certain_ = 0;          // samples up to the last step accepted
  std::vector<double> u_, state_;
  std::vector<Crossing> crossings_;

  // From command to command and from piece to piece of the path.
  Outcome march(Samples& out) {
    const auto began = std::chrono::steady_clock::now();
    const auto seconds = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count(); };
    const double end = run_.until;
    if (settles() && excess(solver_.y.data()) <= 0) settled_since = solver_.t;
    for (int steps = 1;;) {
      if (commands_ && solver_.t >= commands_->due() - slack(commands_->due())) {
        const double* v = solver_.y.data() + m_.n_q;
        if (!close(solver_.y.data()) || !commands_->instant(clock(solver_.t), q_, v)) return Outcome::declined;
        if (commands_->closes_the_plant()) closed_elsewhere();
      }
      if (!begin_contact()) return Outcome::declined;
      if (due(out, solver_.t + slack(solver_.t)) && !sample(run_.times[out.done], solver_.y.data(), out))
        return Outcome::declined;
      certain_ = out.done;
      if (solver_.t >= end) return Outcome::finished;
      const double change = commands_ ? INFINITY : next_piece(solver_.t);
      const double until = commands_ ? std::min(commands_->due(), end) : end;
      bool changes = change < until - slack(until);
      double leg = changes ? change : until;
      if (stride_ == 0 && solver_.t + run_.longest < leg) leg = solver_.t + run_.longest, changes = false;
      if (!solver_.begin(leg, stride_)) return Outcome::declined;
      for (; solver_.t < leg; ++steps) {
        if (!robust_step(solver_, leg, kShortest)) return Outcome::declined;
        if (beyond_ > evaluations - stages_) return Outcome::declined;  // what trials ask for that were rejected is none
        double halt = NAN, broken = NAN;
        if (settles() && !look(halt)) return Outcome::declined;
        if (eventful() && !look_at_contact(broken)) return Outcome::declined;
        const bool breaks = !std::isnan(broken) && !(halt < broken), settled = !breaks && !std::isnan(halt);
        const double reached = breaks ? broken : settled ? halt : solver_.reached;
        count_crossings(reached);
        while (due(out, std::min(reached, leg - 2 * slack(leg)))) {
          const double time = run_.times[out.done];
          if (!solver_.interpolate(time, state_.data()) || !sample(time, state_.data(), out)) return Outcome::declined;
        }
        state_ = solver_.next;
        if (reached < solver_.reached && !solver_.interpolate(reached, state_.data())) return Outcome::declined;
        const double length = breaks ? INFINITY : reached - solver_.t;  // a cut step does not creep
        if (!accept(state_.data(), length)) return Outcome::declined;
        const bool spent = evaluations >= run_.evaluations, late = std::isfinite(run_.seconds) && seconds() >= run_.seconds;
        const bool stopped = steps % 64 == 0 && signals.arrived(), poor = this->poor();
        if ((settled || spent || late || stopped) && !leaving_.may() && out.t[out.done - 1] < reached - slack(reached) &&
            !sample(reached, state_.data(), out))
          return Outcome::declined;
        if (breaks && !halt_joints(reached)) return Outcome::declined;
        reached < solver_.reached ? solver_.cut(reached, state_) : solver_.advance();
        stride_ = changes && solver_.t >= leg ? 0 : solver_.h, certain_ = out.done;
        if (stopped) return Outcome::interrupted;
        if (settled) return Outcome::settled;
        if (poor) return Outcome::left;
        if (spent) return Outcome::exhausted_evaluations;
        if (late) return Outcome::exhausted_seconds;
        if (breaks && solver_.t < leg && !(begin_contact() && solver_.begin(leg, solver_.h))) return Outcome::declined;
      }
    }
  }

  // Joints with dry friction, as ccpin.simulation.plant.stick_slip.
  bool eventful() const { return contact_ && contact_->eventful(); }
  // Lets every one of them rest or slide from here on; false: no answer.
  bool begin_contact() {
    if (!eventful()) return true;
    double* v = solver_.y.data() + m_.n_q;
    return drive(solver_.t, solver_.y.data()) && contact_->begin(v, u_.data(), pushes_);
  }
  // Closes the model at a state and finds u there; false: no answer, or motors cannot give it.
  bool drive(double t, const double* state) { return close(state) && effort(t, state + m_.n_q) && within_bounds(); }
  bool broken_at(double t, const double* state, bool& found) {
    return drive(t, state) && contact_->broken(state + m_.n_q, u_.data(), pushes_, found);
  }
  bool broken_within(double t, bool& found) {
    return solver_.interpolate(t, state_.data()) && broken_at(t, state_.data(), found);
  }
  // When in the step just tried one of them halts or breaks loose; false: no answer.
  bool look_at_contact(double& broken) {
    const double begin = solver_.t, whole = solver_.reached - begin;
    bool found, ends;
    const bool known = broken_at(solver_.reached, solver_.next.data(), ends);  // first: the model is closed there
    const double margin = contact_->margin;
    double before = begin, left = NAN;
    for (int part = 1; part < kContactParts; ++part) {
      const double after = begin + double(part) / kContactParts * whole;
      if (!broken_within(after, found)) return false;
      if (found) return halves(before, after, left, contact_->margin, broken);
      before = after, left = contact_->margin;
    }
    return known && (!ends || halves(before, solver_.reached, left, margin, broken));
  }
  // The same between two times, by halves of what is between them. Where a joint turns back, regula falsi (of Illinois) by
  // the rates that are left before and beyond has told all but the last of these halves beforehand.
  bool halves(double before, double after, double left, double beyond, double& broken) {
    double low = before, high = after;
    int side = 0;
    const auto ask = [&](double t) {
      bool found;
      if (!broken_within(t, found)) return false;
      const int now = found ? 1 : -1;
      if (now == side) (found ? left : beyond) *= 0.5;
      (found ? high : low) = t, (found ? beyond : left) = contact_->margin, side = now;
      return true;
    };
    const double sharp = std::max(kSharp, slack(after));
    for (int guesses = 0; guesses < kGuesses && beyond < 0 && high - low > 2 * sharp; ++guesses) {
      const double part = left > 0 ? left / (left - beyond) : 0.5, guess = low + part * (high - low);
      if (!ask(std::clamp(guess + (part < 0.5 ? sharp : -sharp), low + sharp, high - sharp))) return false;
    }
    while (after - before > std::max(kWidth, slack(after) / 4)) {
      const double middle = 0.5 * (before + after);
      if (low < middle && middle < high && !ask(middle)) return false;
      (middle < high ? before : after) = middle;
    }
    broken = after;
    return true;
  }
  // Tells the joints at the state just accepted who has halted; false where they halt and break loose without end.
  bool halt_joints(double t) {
    recent_.push_back(t);
    if (recent_.size() > kMostEvents) recent_.pop_front();
    if (recent_.size() == kMostEvents && t - recent_.front() < 1e-6) return false;
    bool found;
    if (!broken_at(t, state_.data(), found)) return false;
    if (found) contact_->mode.halted = contact_->turned;
    return true;
  }

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

  // The law's efforts; false where the law's own model has no σ.
  bool effort(double t, const double* v) {
    if (!commands_) return law_.effort(clock(t), q_.data(), v, u_.data());
    u_ = commands_->memory.held;
    return true;
  }
  // Whether motors can give them.
  bool within_bounds() const {
    for (size_t i = 0; i < u_.size(); ++i)
      if (u_[i] < run_.lower[i] || u_[i] > run_.upper[i]) return false;
    return true;
  }

  bool sample(double t, const double* state, Samples& out) {
    if (!close(state) || (w_.model.suspicious() && w_.model.rcond() < 2 * singular_)) return false;
    const int k = out.done++;
    const double* v = state + m_.n_q;
    if (!effort(t, v) || !within_bounds()) return false;
    out.t[k] = t;
    std::copy(q_.begin(), q_.end(), out.q + size_t(k) * m_.n_q);
    std::copy(v, v + m_.n, out.v + size_t(k) * m_.n);
    std::copy(u_.begin(), u_.end(), out.u + size_t(k) * m_.motors);
    std::copy(w_.model.q_free.begin(), w_.model.q_free.end(), out.q_free + size_t(k) * m_.nq);
    out.closure[k] = w_.model.closure();
    double *a = out.a + size_t(k) * m_.n, *f = out.friction + size_t(k) * m_.nv;
    std::fill(f, f + m_.nv, 0.);
    if (!(contact_ ? contact_->sample(v, u_.data(), a, f, pushes_) : w_.model.forward(v, u_.data(), a, pushes_))) return false;
    w_.model.free_velocity(out.v_free + size_t(k) * m_.nv);
    if (leaving_.may()) w_.model.free_acceleration(a, out.a_free + size_t(k) * m_.nv);
    return true;
  }

  // Settling, as ccpin.simulation.events.settling.
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
  bool inside(double t, bool& found) {
    if (!solver_.interpolate(t, state_.data())) return false;
    found = excess(state_.data()) <= 0;
    return true;
  }
  // Where in the step just tried the band is entered and left, and when the motion has settled; false: no answer.
  bool look(double& halt) {
    double since = settled_since, before = solver_.t;
    crossings_.clear();
    for (int part = 1; part <= kParts; ++part) {
      const double after = part == kParts ? solver_.reached : solver_.t + part * (solver_.reached - solver_.t) / kParts;
      bool now, was;
      if (!inside(after, now)) return false;
      if (now == std::isnan(since)) {
        double low = before, high = after;
        if (!inside(before, was)) return false;
        while (was != now && high - low > std::max(1e-13, slack(high) / 4)) {
          const double middle = low + 0.5 * (high - low);
          bool there;
          if (!inside(middle, there)) return false;
          (there == now ? high : low) = middle;
        }
        const double crossing = was == now ? before : high;
        if (!now && crossing - since >= run_.settling.hold) break;
        since = now ? crossing : NAN;
        crossings_.push_back({crossing, now});
      }
      before = after;
    }
    if (!std::isnan(since) && since + run_.settling.hold <= solver_.reached)
      halt = std::max(since + run_.settling.hold, solver_.t);
    return true;
  }
  // Since when it is settled, as of a time.
  void count_crossings(double until) {
    for (const Crossing& crossing : crossings_)
      if (crossing.t <= until) settled_since = crossing.inside ? crossing.t : NAN;
  }
};

// A motion that is stepped with u held.
class Stepper : public Follower {
 public:
  int evaluations = 0;
  double last_step = 0;  // what the integrator would try next
  Signals signals;

  Stepper(Workspace& w, const Tableau& tableau, double rtol, double atol, double longest, double singular,
          const Pushes& pushes, const Leaving& leaving)
      : Follower(w, singular, longest, pushes, leaving), tableau_(tableau),
        solver_(*this, tableau_, m_.n_q + m_.n, rtol, atol, longest), scratch_(m_.n) {}

  // Begin where the model is closed; the coordinates are left where their leverage is more than `most`.
  void start(const double* q, const double* v, double first, double most) {
    std::copy(q, q + m_.n_q, solver_.y.data()), std::copy(v, v + m_.n, solver_.y.data() + m_.n_q);
    last_step = first, leaving_.most = most;
    start_here();
  }
  // `state`, `acceleration` and `reached` then tell; false: no answer, and no place to go on from.
  bool step(const double* u, double dt) {
    u_ = u, solver_.t = 0;
    if (!solver_.begin(dt, last_step)) return false;
    for (int steps = 1; solver_.t < dt; ++steps) {
      if (!robust_step(solver_, dt, kShortest) || !accept(solver_.next.data(), solver_.reached - solver_.t)) return false;
      if (poor()) return false;
      solver_.advance();
      if (steps % 64 == 0 && signals.arrived()) break;
    }
    last_step = solver_.h;
    return true;
  }
  double reached() const { return solver_.t; }  // how far the step has come: dt, unless it was interrupted
  const double* state() const { return solver_.y.data(); }
  const double* acceleration() const { return solver_.slope() + m_.n_q; }
  // q̇′ there.
  void free_velocity(double* out) {
    w_.model.spread(state() + m_.n_q);
    w_.model.free_velocity(out);
  }
  // q̈′ there, by a q̈ computed anew; false: no answer.
  bool free_acceleration(double* out) {
    std::vector<double>& a = scratch_;
    if (!w_.model.forward(state() + m_.n_q, u_, a.data(), pushes_)) return false;
    w_.model.free_acceleration(a.data(), out);
    return true;
  }

  bool operator()(double, const double* state, double* rate) {
    ++evaluations;
    return close(state) && rates(state + m_.n_q, u_, rate);
  }

 private:
  const Tableau tableau_;
  Integrator<Stepper> solver_;
  std::vector<double> scratch_;
  const double* u_ = nullptr;
};

}  // namespace ccpin
