// Reads a law, a run and an integrator's coefficients from the plain numbers of ccpin.simulation.integration.core_runs.
#pragma once
#include "reading.hpp"
#include "simulate.hpp"

namespace ccpin {

// Wrenches on links, a row each of joint, force, moment and point (ccpin.dynamics.wrenches); false where they are not that.
inline bool read_pushes(const In& rows, const Mechanism& m, Pushes& pushes) {
  if (!rows.given()) return true;
  if (!rows.is_matrix(10) || !In::finite(rows.data, rows.rows * 10)) return false;
  for (const double* x = rows.data; x < rows.data + rows.rows * 10; x += 10) {
    if (!(x[0] >= 1 && x[0] < double(m.joints.size()))) return false;
    pushes.push_back({int(x[0]), Vec3(x[1], x[2], x[3]), Vec3(x[4], x[5], x[6]), Vec3(x[7], x[8], x[9])});
  }
  return true;
}

inline Learning read_learning(nb::dict d, const Mechanism& m) {
  using namespace reading;
  Learning l;
  l.known = numbers(d["known"], constants(m)), l.estimate = numbers(d["estimate"]);
  const size_t k = l.estimate.size();
  l.basis = numbers(d["basis"], l.known.size() * k), l.rates = numbers(d["rates"], k);
  l.lower = numbers(d["lower"], k), l.upper = numbers(d["upper"], k);
  for (size_t j = 0; j < k; ++j) require(l.lower[j] <= l.upper[j], "a constant's bounds are the wrong way round");
  return l;
}

inline Law read_law(nb::dict d, const Mechanism& m) {
  using namespace reading;
  const size_t n = m.n;
  Law law;
  law.kind = LawKind(place_of(text(d["kind"]), kLawNames, "law"));
  if (law.kind == LawKind::constant) return law.constant = numbers(d["constant"], m.motors), law;
  law.path.start = numbers(d["start"], m.n_q), law.path.breaks = numbers(d["breaks"]);
  law.path.degree = integer(d["degree"]);
  require(law.path.degree >= -1 && law.path.degree < 1000, "a path has a wrong degree");
  require(law.path.breaks.size() != 1, "a path has one break");
  for (size_t k = 1; k < law.path.breaks.size(); ++k)
    require(law.path.breaks[k] > law.path.breaks[k - 1], "a path's breaks do not increase");
  const size_t pieces = law.path.breaks.empty() ? 0 : law.path.breaks.size() - 1;
  law.path.coefficients = numbers(d["coefficients"], pieces * (law.path.degree + 1) * n);
  law.K_p = numbers(d["K_p"], n * n), law.K_v = numbers(d["K_v"], n * n);
  if (law.kind == LawKind::adaptive) law.learning = read_learning(nb::cast<nb::dict>(d["learning"]), m);
  else law.constant = numbers(d["constant"], n);
  return law;
}

inline Sampling read_sampling(nb::dict d, const Mechanism& m) {
  using namespace reading;
  Sampling s{number(d["period"]), number(d["gain"]), nb::cast<bool>(d["differentiates"]), numbers(d["resolution"]),
             nb::cast<std::vector<double>>(d["limit"]), number(d["start"]), {}};
  s.memory = {numbers(d["reading"], m.n_q), numbers(d["velocity"], m.n), numbers(d["held"], m.n), {}, number(d["count"])};
  const std::vector<double> pending = numbers(d["pending"]);
  require(m.n && pending.size() % m.n == 0, "commands on their way are not those of u");
  for (size_t k = 0; k < pending.size(); k += m.n)
    s.memory.pending.emplace_back(pending.begin() + k, pending.begin() + k + m.n);
  require(s.period > 0 && s.gain >= 0 && s.gain <= 1, "a sampled loop's period or filter is out of its range");
  require(s.memory.count >= 0 && s.memory.pending.size() < 1000000, "a sampled loop's delay is out of its range");
  require(s.resolution.empty() || (m.plain && int(s.resolution.size()) == m.n), "encoders are not those of q");
  require(int(s.limit.size()) == m.n, "a sampled loop's limits are not those of u");
  for (double x : s.resolution) require(x > 0, "an encoder's resolution is not positive");
  for (double x : s.limit) require(x >= 0, "a limit is not positive");
  return s;
}

// Joints with friction, and their mode (ccpin.simulation.plant.stick_slip).
inline Friction read_friction(nb::dict d, const Mechanism& m) {
  using namespace reading;
  const std::vector<int> component = integers(d["component"]);
  const size_t k = component.size();
  const std::vector<int> coordinate = integers(d["coordinate"], k);
  const std::vector<double> coulomb = numbers(d["coulomb"], k), viscous = numbers(d["viscous"], k);
  const std::vector<double> breakaway = numbers(d["breakaway"], k), speed = numbers(d["stribeck_speed"], k);
  Friction f{{}, numbers(d["signs"], k), integers(d["rest"], k), integers(d["halted"], k), nb::cast<bool>(d["locked"])};
  require(k > 0, "friction of no joint");
  for (size_t i = 0; i < k; ++i) {
    require(component[i] >= 0 && component[i] < m.nv, "friction of a joint that is none");
    require(coordinate[i] >= -1 && coordinate[i] < m.n, "friction of an independent velocity that is none");
    require(coulomb[i] >= 0 && viscous[i] >= 0, "a level of friction is negative");
    require(breakaway[i] >= coulomb[i] && speed[i] > 0, "a breakaway level is below Coulomb's, or a Stribeck speed not positive");
    f.joints.push_back({component[i], coordinate[i], coulomb[i], viscous[i], breakaway[i], speed[i]});
  }
  return f;
}

// What tells when coordinates are left (ccpin.simulation.integration.coordinate_switching); none: they never are.
inline Leaving read_leaving(nb::object given, const Mechanism& m) {
  using namespace reading;
  if (given.is_none()) return {};
  const nb::dict d = nb::cast<nb::dict>(given);
  Leaving l{number(d["most"]), number(d["turn"]), numbers(d["rows"], m.nv), numbers(d["columns"], m.n)};
  require(l.most > 0 && l.turn > 0, "a bound of leverage or of turns is not positive");
  return l;
}

inline Run read_run(nb::dict d, const Mechanism& m) {
  using namespace reading;
  const auto any = [&](const char* name) { return nb::cast<double>(d[name]); };
  Run r;
  r.begin = number(d["begin"]), r.until = number(d["until"]), r.stride = number(d["first_step"]);
  r.leaving = read_leaving(d["leaving"], m);
  r.times = numbers(d["times"]), r.start = numbers(d["start"], m.n_q + m.n), r.origin = number(d["origin"]);
  r.rtol = number(d["rtol"]), r.atol = number(d["atol"]), r.longest = any("max_step");
  r.singular = number(d["singular_rcond"]), r.evaluations = any("evaluations"), r.seconds = any("seconds");
  r.settling = {numbers(d["goal"]), any("band"), any("speed"), any("hold")};
  r.lower = nb::cast<std::vector<double>>(d["lower"]), r.upper = nb::cast<std::vector<double>>(d["upper"]);
  require(int(r.lower.size()) == m.motors && int(r.upper.size()) == m.motors, "bounds of u have a wrong length");
  require(read_pushes(nb::cast<In>(d["wrenches"]), m, r.pushes), "wrenches are not rows of ten numbers");
  if (!d["sampling"].is_none()) r.sampling = read_sampling(nb::cast<nb::dict>(d["sampling"]), m);
  if (!d["friction"].is_none()) r.friction = read_friction(nb::cast<nb::dict>(d["friction"]), m);
  require(r.until >= r.begin && r.stride >= 0, "a run ends before it begins, or its first step is negative");
  require(r.leaving.may() || !r.times.empty(), "a run has no times");
  require(r.times.empty() || r.times.front() >= r.begin, "a run's times are earlier than it");
  require(!r.leaving.may() || (r.settling.goal.empty() && !r.sampling), "a run that may leave its coordinates is sampled");
  for (size_t k = 1; k < r.times.size(); ++k) require(r.times[k] > r.times[k - 1], "a run's times do not increase");
  require(r.rtol > 0 && r.atol > 0 && r.longest > 0, "a tolerance or step is not positive");
  require(r.settling.goal.empty() || int(r.settling.goal.size()) == m.n_q, "a goal has a wrong length");
  return r;
}

inline Tableau read_tableau(nb::dict d) {
  using namespace reading;
  Tableau t;
  t.A = numbers(d["A"]), t.B = numbers(d["B"]), t.C = numbers(d["C"]);
  t.E = numbers(d["E"]), t.E_low = numbers(d["E_low"]), t.P = numbers(d["P"]);
  t.stages = int(t.B.size()), t.extra = integer(d["extra"]), t.columns = integer(d["columns"]);
  t.error_order = integer(d["error_order"]);
  require(t.stages > 0 && t.extra >= 0 && t.extra < 100 && t.error_order >= 0, "a tableau has wrong sizes");
  const size_t all = size_t(t.stages) + 1 + t.extra, used = size_t(t.stages) + (t.extra ? 1 + t.extra : 0);
  require(t.columns >= int(t.extra ? all - 1 : t.stages), "a tableau has too few columns");
  require(t.A.size() >= used * t.columns && t.A.size() % t.columns == 0 && t.C.size() >= used, "a tableau is too short");
  require(int(t.E.size()) == t.stages + 1 && (t.E_low.empty() || t.E_low.size() == t.E.size()), "a wrong error estimate");
  require(t.P.size() == (t.eighth() ? 4 * all : size_t(t.stages + 1) * 4), "a wrong interpolant");
  return t;
}

}  // namespace ccpin
