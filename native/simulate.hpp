// The closed loop D q̈ + C q̇ + g = u (22) under a law of the core, sampled at given times. What is out of the ordinary
// (a σ that fails, a singularity coming near) is left to the reference: the run then gives no answer. Where it may leave its
// coordinates for others (ccpin.simulation.following) it ends there instead, with all it has.
#pragma once
#include "arrays.hpp"
#include "integrator.hpp"
#include "laws.hpp"

namespace ccpin {

struct Settling { std::vector<double> goal; double band = 0, speed = 0, hold = 0; };

// When coordinates are left: an entry of ρ, in units that the weights make comparable, is too large, or a component of a
// ball joint has turned too far from its chart's centre.
struct Leaving {
  static constexpr double kTurned = 2;  // rad
  double most = INFINITY;  // infinite: never
  std::vector<double> rows, columns;
  bool may() const { return most < INFINITY; }
};

struct Run {
  std::vector<double> times, start;   // start: (q, q̇), at the time `begin`
  double begin, first_step;           // a first step of zero: it is chosen
  double rtol, atol, longest, singular;
  Settling settling;                  // no goal: run to the end
  Leaving leaving;
};

// Where samples go: one row each of t, q, q̇, u, q′, q̇′ and |φ|.
struct Samples {
  double *q, *v, *u, *q_free, *v_free, *closure;
  int done = 0;
};

enum class Outcome { finished, settled, interrupted, left, declined };

class Simulation {
 public:
  int evaluations = 0;
  double settled_since = NAN;
  double t = 0, h = 0;                    // where the run ended, and the step it would have taken next
  std::vector<double> y, q_free;          // (q, q̇) and q′ there

  Simulation(Workspace& w, const Law& law, const Run& run)
      : w_(w), m_(w.model.m), law_(w, law), run_(run), u_(m_.motors), q_(m_.n_q) {
    w.model.remember(near_);
  }

  Outcome run(const Tableau& tableau, Samples& out) {
    Integrator<Simulation> solver(*this, tableau, run_.start, run_.begin, run_.times.back(), run_.rtol, run_.atol,
                                  run_.longest, run_.first_step);
    const Outcome outcome = march(solver, out);
    t = solver.t, h = solver.h, y = solver.y, q_free = near_.q_free;
    return outcome == Outcome::declined && run_.leaving.may() ? Outcome::left : outcome;
  }

  // The right-hand side (q̇, q̈); false where σ or q̈ does not exist.
  bool operator()(double t, const double* state, double* rate) {
    ++evaluations;
    if (!close(state)) return false;
    const double* v = state + m_.n_q;
    law_.effort(t, q_.data(), v, u_.data());
    for (const Coordinate& k : m_.coordinates) coordinate_rate(k, q_.data() + k.q, v + k.v, rate + k.q);
    return w_.model.forward(v, u_.data(), rate + m_.n_q);
  }

 private:
  static constexpr double kCreeping = 1e-7, kCreepingRcond = 1e-3, kShortest = 1e-10;
  static constexpr int kMostCreeping = 200;
  Workspace& w_;
  const Mechanism& m_;
  LawRunner law_;
  const Run& run_;
  std::vector<double> u_, q_;
  ClosedPoint near_;

  Outcome march(Integrator<Simulation>& solver, Samples& out) {
    std::vector<double> state(run_.start.size());
    if (solver.failed) return Outcome::declined;
    if (run_.times[0] == run_.begin && !sample(run_.begin, solver.y.data(), out)) return Outcome::declined;
    double shortened = 0;
    for (int steps = 1, creeping = 0; out.done < int(run_.times.size()); ++steps) {
      if (settled(solver.y.data(), out)) return Outcome::settled;
      if (!solver.step()) {  // σ fails at a trial: again, a quarter as far
        shortened = 0.25 * (shortened > 0 ? shortened : std::min(solver.h, run_.times.back() - solver.t));
        if (solver.failed || shortened < kShortest || !solver.restart(shortened)) return Outcome::declined;
        continue;
      }
      shortened = 0;
      for (; out.done < int(run_.times.size()) && run_.times[out.done] <= solver.reached;) {
        const double time = run_.times[out.done];
        const bool exact = time == solver.reached;
        if (!exact && !solver.interpolate(time, state.data())) return Outcome::declined;
        const double* at = exact ? solver.next.data() : state.data();
        if (!sample(time, at, out)) return Outcome::declined;
        if (settled(at, out)) return Outcome::settled;
      }
      if (!close(solver.next.data()) || (singular() && !run_.leaving.may())) return Outcome::declined;
      const bool stuck = run_.leaving.may() ? run_.longest > kCreeping : w_.model.rcond() < kCreepingRcond;
      creeping = solver.reached - solver.t < kCreeping && stuck ? creeping + 1 : 0;
      w_.model.remember(near_);
      solver.advance();
      if (creeping >= kMostCreeping) return Outcome::declined;
      if (run_.leaving.may() && out.done < int(run_.times.size()) && (singular() || poor())) return Outcome::left;
      if (steps % 64 == 0 && interrupted()) return Outcome::interrupted;
    }
    return Outcome::finished;
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

  bool sample(double t, const double* state, Samples& out) {
    if (!close(state) || (singular() && !run_.leaving.may())) return false;
    const int k = out.done++;
    const double* v = state + m_.n_q;
    law_.effort(t, q_.data(), v, u_.data());
    std::copy(q_.begin(), q_.end(), out.q + size_t(k) * m_.n_q);
    std::copy(v, v + m_.n, out.v + size_t(k) * m_.n);
    std::copy(u_.begin(), u_.end(), out.u + size_t(k) * m_.motors);
    std::copy(w_.model.q_free.begin(), w_.model.q_free.end(), out.q_free + size_t(k) * m_.nq);
    free_velocity(v, out.v_free + size_t(k) * m_.nv);
    out.closure[k] = w_.model.closure();
    return true;
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

  // Whether the last sample ends a stay of `hold` seconds within the band; told once a sample.
  bool settled(const double* state, const Samples& out) {
    if (run_.settling.goal.empty() || judged_ == out.done) return false;
    judged_ = out.done;
    const double t = run_.times[out.done - 1];
    double step[6], error = 0, speed = 0;
    for (const Coordinate& k : m_.coordinates) {
      coordinate_difference(k, out.q + size_t(out.done - 1) * m_.n_q + k.q, run_.settling.goal.data() + k.q, step);
      for (int i = 0; i < k.nv; ++i) error = std::max(error, std::abs(step[i]));
    }
    for (int i = 0; i < m_.n; ++i) speed = std::max(speed, std::abs(state[m_.n_q + i]));
    if (error > run_.settling.band || speed > run_.settling.speed) settled_since = NAN;
    else if (std::isnan(settled_since)) settled_since = t;
    return t - settled_since >= run_.settling.hold * (1 - 1e-12);
  }
  int judged_ = 0;

  static bool interrupted() {
    nb::gil_scoped_acquire acquire;
    if (PyErr_CheckSignals() == 0) return false;
    PyErr_Clear();
    return true;
  }
};

}  // namespace ccpin
