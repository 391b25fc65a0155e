// What Python calls. Every function answers, or declines with None, and the NumPy reference then answers or explains:
// messages exist once. `near` is a configuration on the branch wanted (None: the reference); `q` given: at σ(q) from
// there; q None: at `near` itself, which is closed. `wrenches`: on links, a row each (read_pushes).
#pragma once
#include "batch.hpp"
#include "forces.hpp"
#include "run_specification.hpp"
#include "specification.hpp"

namespace ccpin {

class Kernel {
 public:
  const nb::dict numbers;  // what it was made of, for pickling
  const Mechanism m;

  explicit Kernel(nb::dict specification) : numbers(specification), m(Reader(specification).mechanism()), pool_(m) {}

  nb::object constraints(In q_free) {
    if (!q_free.is_vector(m.nq)) return nb::none();
    Pool::Lease w(pool_);
    double *phi, *jacobian;
    nb::object a = new_array({m.m}, phi), b = new_array({m.m, m.nv}, jacobian);
    w->model.value(q_free.data, phi, jacobian);
    return nb::make_tuple(a, b);
  }
  nb::object constraint_rate(In q_free, In v_free) {
    if (!q_free.is_vector(m.nq) || !v_free.is_vector(m.nv)) return nb::none();
    Pool::Lease w(pool_);
    double* rate;
    nb::object a = new_array({m.m, m.nv}, rate);
    w->model.rate(q_free.data, v_free.data, rate);
    return a;
  }

  nb::object sigma(In q, In near) {
    Pool::Lease w(pool_);
    if (!close(w->model, near, q, false)) return nb::none();
    return closed(w->model);
  }
  nb::object closed_point(In near, In q) {  // q′ and ρ
    Pool::Lease w(pool_);
    if (!close(w->model, near, q)) return nb::none();
    double* rho;
    nb::object a = new_array({m.nv, m.n}, rho);
    write_rho(w->model, rho);
    return nb::make_tuple(closed(w->model), a);
  }
  nb::object blocked(In near, In q) {  // how much of the way to q leads next to where it ends; q′ and 1/κ there
    if ((near.given() && !(near.is_vector(m.nq) && on_manifold(near.data))) || !q.is_vector(m.n_q)) return nb::none();
    Pool::Lease w(pool_);
    const double* start = near.given() ? near.data : m.reference.data();
    double done = 1;
    close_at(w->model, q.data, [&](const double* x) { return (done = w->model.ends_at(x, start)) < 1; });
    if (!(done < 1)) return nb::none();
    const nb::object reached = closed(w->model);
    const std::vector<double> there = w->model.q_free;
    if (!w->model.at(there.data())) return nb::none();
    return nb::make_tuple(done, reached, w->model.rcond());
  }
  nb::object rcond(In q_free) {
    Pool::Lease w(pool_);
    if (!close(w->model, q_free, In())) return nb::none();
    return nb::cast(w->model.rcond());
  }

  nb::object terms(In near, In v, In q) {
    Pool::Lease w(pool_);
    if (!v.is_vector(m.n) || !close(w->model, near, q)) return nb::none();
    TermsOut out;
    const nb::object arrays = out.allocate(m);
    out.write(*w, v.data, 0);
    return arrays;
  }
  nb::object forward_dynamics(In near, In v, In u, In q, In wrenches) {
    Pool::Lease w(pool_);
    Pushes pushes;
    if (!v.is_vector(m.n) || !u.is_vector(m.motors) || !close(w->model, near, q, wrenches, pushes)) return nb::none();
    double* out;
    nb::object a = new_array({m.n}, out);
    if (!w->model.forward(v.data, u.data, out, pushes)) return nb::none();
    return a;
  }
  nb::object generalized_force(In near, In v, In acceleration, In q, In wrenches) {
    Pool::Lease w(pool_);
    Pushes pushes;
    if (!v.is_vector(m.n) || !acceleration.is_vector(m.n) || !close(w->model, near, q, wrenches, pushes)) return nb::none();
    double* out;
    nb::object a = new_array({m.n}, out);
    w->model.inverse(v.data, acceleration.data, out, pushes);
    return a;
  }
  nb::object inverse_dynamics(In near, In v, In acceleration, In q, In wrenches) {
    Pool::Lease w(pool_);
    Pushes pushes;
    if (!v.is_vector(m.n) || !acceleration.is_vector(m.n) || !close(w->model, near, q, wrenches, pushes)) return nb::none();
    double* out;
    nb::object a = new_array({m.motors}, out);
    if (!w->motors.efforts(v.data, acceleration.data, out, pushes)) return nb::none();
    return a;
  }
  nb::object regressor(In near, In v, In acceleration, In v_r, In q) {
    Pool::Lease w(pool_);
    if (!v.is_vector(m.n) || !acceleration.is_vector(m.n) || !v_r.is_vector(m.n) || !close(w->model, near, q)) return nb::none();
    double* out;
    nb::object a = new_array({m.n, ccpin::constants(m)}, out);
    w->regressor.matrix(v.data, acceleration.data, v_r.data, out);
    return a;
  }
  nb::object gravity(In near, In q) {
    Pool::Lease w(pool_);
    if (!close(w->model, near, q)) return nb::none();
    double* out;
    nb::object a = new_array({m.n}, out);
    w->model.gravity_at_rest(out);
    return a;
  }
  nb::object transmission(In near, In q) {
    Pool::Lease w(pool_);
    if (!close(w->model, near, q)) return nb::none();
    double* out;
    nb::object a = new_array({m.n, m.motors}, out);
    std::fill(out, out + size_t(m.n) * m.motors, 0.);
    w->model.transmission(out, m.motors);
    return a;
  }
  nb::object constraint_forces(In near, In v, In u, In q, In wrenches) {
    Pool::Lease w(pool_);
    Pushes pushes;
    if (!v.is_vector(m.n) || !u.is_vector(m.motors) || !close(w->model, near, q, wrenches, pushes)) return nb::none();
    std::vector<double> a(m.n), tau(m.n);
    if (!w->model.forward(v.data, u.data, a.data(), pushes)) return nb::none();
    w->model.inverse(v.data, a.data(), tau.data(), pushes);
    double* out;
    nb::object lambda = new_array({m.m}, out);
    w->model.multipliers(u.data, out);
    return lambda;
  }
  nb::object bearing_forces(In near, In v, In u, In q, In wrenches) {
    Pool::Lease w(pool_);
    Pushes pushes;
    if (!v.is_vector(m.n) || !u.is_vector(m.motors) || !close(w->model, near, q, wrenches, pushes)) return nb::none();
    std::vector<double> a(m.n), tau(m.n), lambda(m.m);
    if (!w->model.forward(v.data, u.data, a.data(), pushes)) return nb::none();
    w->model.inverse(v.data, a.data(), tau.data(), pushes);
    w->model.multipliers(u.data, lambda.data());
    double *closures, *joints, *poses;
    const Py_ssize_t count = m.joints.size();
    nb::object x = new_array({Py_ssize_t(m.loops.size()), 6}, closures), y = new_array({count - 1, 6}, joints),
               z = new_array({count, 4, 4}, poses);
    ccpin::bearing_forces(w->model, lambda.data(), closures, joints, poses);
    return nb::make_tuple(x, y, z);
  }
  nb::object energy(In near, In v, In q) {
    Pool::Lease w(pool_);
    if (!v.is_vector(m.n) || !close(w->model, near, q)) return nb::none();
    const ReducedModel::Energy e = w->model.energy(v.data);
    return nb::make_tuple(e.kinetic, e.potential);
  }
  nb::object generalized_force_derivatives(In near, In v, In acceleration, In q, In wrenches) {
    Pool::Lease w(pool_);
    Pushes pushes;
    if (!v.is_vector(m.n) || !acceleration.is_vector(m.n) || !close(w->model, near, q, wrenches, pushes)) return nb::none();
    double *dq, *dv, *da;
    nb::object a = new_array({m.n, m.n}, dq), b = new_array({m.n, m.n}, dv), c = new_array({m.n, m.n}, da);
    w->derivatives.generalized_force(v.data, acceleration.data, nullptr, dq, dv, da, pushes);
    return nb::make_tuple(a, b, c);
  }
  nb::object forward_dynamics_derivatives(In near, In v, In u, In q, In wrenches) {
    Pool::Lease w(pool_);
    Pushes pushes;
    if (!v.is_vector(m.n) || !u.is_vector(m.motors) || !close(w->model, near, q, wrenches, pushes)) return nb::none();
    double *dq, *dv, *du;
    nb::object a = new_array({m.n, m.n}, dq), b = new_array({m.n, m.n}, dv), c = new_array({m.n, m.motors}, du);
    if (!slopes(*w, v.data, u.data, dq, dv, du, pushes)) return nb::none();
    return nb::make_tuple(a, b, c);
  }

  // Batches: one answer a row of (B, ·) arrays, and a mask of the rows answered; the others are NaN.
  nb::object sigma_many(In Q, In near, int threads) {
    double* out;
    const Batch batch(*this, near, Q);
    if (!batch.good) return nb::none();
    const nb::object a = new_array({Q.rows, m.nq}, out);
    return with_mask(a, batch, threads, [&](Workspace& w, Py_ssize_t k, bool good) {
      if (good) std::copy(w.model.q_free.begin(), w.model.q_free.end(), out + k * m.nq);
      else std::fill_n(out + k * m.nq, m.nq, NAN);
      return good;
    });
  }
  nb::object terms_many(In Q, In V, In near, int threads) {
    const Batch batch(*this, near, Q);
    if (!batch.good || !rows_of(V, m.n, Q.rows)) return nb::none();
    TermsOut out;
    const nb::object arrays = out.allocate(m, Q.rows);
    return with_mask(arrays, batch, threads, [&](Workspace& w, Py_ssize_t k, bool good) {
      if (good) out.write(w, V.data + k * m.n, k);
      else out.blank(m, k);
      return good;
    });
  }
  nb::object forward_dynamics_many(In Q, In V, In U, In near, int threads) {
    const Batch batch(*this, near, Q);
    if (!batch.good || !rows_of(V, m.n, Q.rows) || !rows_of(U, m.motors, Q.rows)) return nb::none();
    double* out;
    const nb::object a = new_array({Q.rows, m.n}, out);
    return with_mask(a, batch, threads, [&](Workspace& w, Py_ssize_t k, bool good) {
      good = good && w.model.forward(V.data + k * m.n, U.data + k * m.motors, out + k * m.n);
      if (!good) std::fill_n(out + k * m.n, m.n, NAN);
      return good;
    });
  }
  nb::object generalized_force_many(In Q, In V, In A, In near, int threads) {
    const Batch batch(*this, near, Q);
    if (!batch.good || !rows_of(V, m.n, Q.rows) || !rows_of(A, m.n, Q.rows)) return nb::none();
    double* out;
    const nb::object a = new_array({Q.rows, m.n}, out);
    return with_mask(a, batch, threads, [&](Workspace& w, Py_ssize_t k, bool good) {
      if (good) w.model.inverse(V.data + k * m.n, A.data + k * m.n, out + k * m.n);
      else std::fill_n(out + k * m.n, m.n, NAN);
      return good;
    });
  }
  nb::object inverse_dynamics_many(In Q, In V, In A, In near, int threads) {
    const Batch batch(*this, near, Q);
    if (!batch.good || !rows_of(V, m.n, Q.rows) || !rows_of(A, m.n, Q.rows)) return nb::none();
    double* out;
    const nb::object a = new_array({Q.rows, m.motors}, out);
    return with_mask(a, batch, threads, [&](Workspace& w, Py_ssize_t k, bool good) {
      good = good && w.motors.efforts(V.data + k * m.n, A.data + k * m.n, out + k * m.motors);
      if (!good) std::fill_n(out + k * m.motors, m.motors, NAN);
      return good;
    });
  }
  nb::object regressor_many(In Q, In V, In A, In V_r, In near, int threads) {
    const Batch batch(*this, near, Q);
    if (!batch.good || !rows_of(V, m.n, Q.rows) || !rows_of(A, m.n, Q.rows) || !rows_of(V_r, m.n, Q.rows)) return nb::none();
    double* out;
    const Py_ssize_t columns = ccpin::constants(m), size = m.n * columns;
    const nb::object a = new_array({Q.rows, m.n, columns}, out);
    return with_mask(a, batch, threads, [&](Workspace& w, Py_ssize_t k, bool good) {
      if (good) w.regressor.matrix(V.data + k * m.n, A.data + k * m.n, V_r.data + k * m.n, out + k * size);
      else std::fill_n(out + k * size, size, NAN);
      return good;
    });
  }
  nb::object forward_dynamics_derivatives_many(In Q, In V, In U, In near, int threads) {
    const Batch batch(*this, near, Q);
    if (!batch.good || !rows_of(V, m.n, Q.rows) || !rows_of(U, m.motors, Q.rows)) return nb::none();
    double *dq, *dv, *du;
    const size_t square = size_t(m.n) * m.n, wide = size_t(m.n) * m.motors;
    const nb::object a = new_array({Q.rows, m.n, m.n}, dq), b = new_array({Q.rows, m.n, m.n}, dv),
                     c = new_array({Q.rows, m.n, m.motors}, du);
    return with_mask(nb::make_tuple(a, b, c), batch, threads, [&](Workspace& w, Py_ssize_t k, bool good) {
      double *x = dq + k * square, *y = dv + k * square, *z = du + k * wide;
      good = good && slopes(w, V.data + k * m.n, U.data + k * m.motors, x, y, z);
      if (!good) std::fill_n(x, square, NAN), std::fill_n(y, square, NAN), std::fill_n(z, wide, NAN);
      return good;
    });
  }

  // A run under a law of the core: how many samples, then t, q, q̇, q̈, u, q′, |φ|, q̇′ and q̈′ (without rows where the run may
  // not leave its coordinates), how it ended, since when it is settled, evaluations, what a signal's handler raised, what a
  // sampled loop remembers; and where it has come to: time, (q, q̇), q′, the step it would take next, and how many steps in
  // a row were next to nothing.
  // `nominal`: the kernel of the law's model where that is another than the plant's, and q′ of it where the run begins.
  nb::object simulate(In near, nb::dict law, nb::dict run, nb::dict tableau, Kernel* nominal, In nominal_near) {
    if (nominal && (nominal->m.n != m.n || nominal->m.n_q != m.n_q || nominal->m.motors != m.motors || !nominal->m.direct))
      return nb::none();
    const Mechanism& known = nominal ? nominal->m : m;
    const auto [a, b, c] =
        reading::checked([&] { return std::tuple(read_law(law, known), read_run(run, m), read_tableau(tableau)); });
    if (!m.direct && (a.kind != LawKind::constant || b.sampling)) return nb::none();
    if (a.kind == LawKind::adaptive && !b.sampling) return nb::none();
    const Py_ssize_t rows = b.times.size() + 1, free = b.leaving.may() ? rows : 0;  // and where it stops
    Pool::Lease w(pool_);
    In q;
    q.data = b.start.data(), q.rows = 1, q.size = m.n_q, q.dimensions = 1;
    if (!close(w->model, near, q)) return nb::none();
    std::optional<Pool::Lease> own;
    if (nominal) {
      own.emplace(nominal->pool_);
      if (!nominal->close((*own)->model, nominal_near, q)) return nb::none();
    }
    Samples out;
    const nb::object T = new_array({rows}, out.t), Q = new_array({rows, m.n_q}, out.q), V = new_array({rows, m.n}, out.v),
                     A = new_array({rows, m.n}, out.a), U = new_array({rows, m.motors}, out.u),
                     X = new_array({rows, m.nq}, out.q_free), E = new_array({rows}, out.closure),
                     W = new_array({rows, m.nv}, out.v_free), F = new_array({rows, m.nv}, out.friction),
                     B = new_array({free, m.nv}, out.a_free);
    Simulation simulation(*w, own ? **own : *w, a, b, c);
    Outcome outcome;
    {
      nb::gil_scoped_release release;
      outcome = simulation.run(out);
    }
    const nb::object raised = simulation.signals.raised ? nb::steal(simulation.signals.raised) : nb::none();
    if (outcome == Outcome::declined && simulation.signals.raised) {  // nobody else would tell
      PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(raised.ptr())), raised.ptr());
      throw nb::python_error();
    }
    if (outcome == Outcome::declined) return nb::none();
    constexpr const char* names[] = {"finished", "settled", "evaluations", "seconds", "interrupted", "left"};
    return nb::make_tuple(out.done, T, Q, V, A, U, X, W, F, E, B, names[int(outcome)], simulation.settled_since,
                          simulation.evaluations, raised, memory_of(simulation), simulation.time(),
                          array_of(simulation.state()), array_of(simulation.place()), simulation.stride(), simulation.creeping(),
                          mode_of(simulation.contact()));
  }

  // An adaptive law asked again at the samples of a motion, rows of t, q, q̇ and of q′ near σ(q): π̂ as each used it, and u as
  // held from there on.
  nb::object learnt(nb::dict law, nb::dict sampling, In T, In Q, In V, In X) {
    const Py_ssize_t rows = T.size;
    const bool good = T.dimensions == 1 && rows_of(Q, m.n_q, rows) && rows_of(V, m.n, rows) && rows_of(X, m.nq, rows);
    if (!good || !m.direct) return nb::none();
    const auto [a, b] = reading::checked([&] { return std::pair(read_law(law, m), read_sampling(sampling, m)); });
    if (a.kind != LawKind::adaptive) return nb::none();
    Pool::Lease w(pool_);
    LawRunner runner(*w, a, false);
    SampledCommands commands(*w, runner, b);
    const Py_ssize_t k = runner.estimate.size();
    double *estimates, *efforts;
    const nb::object first = new_array({rows, k}, estimates), second = new_array({rows, m.n}, efforts);
    for (Py_ssize_t row = 0; row < rows; ++row, estimates += k, efforts += m.n) {
      if (row % 1024 == 0 && PyErr_CheckSignals() != 0) throw nb::python_error();
      const std::vector<double> q(Q.data + row * m.n_q, Q.data + (row + 1) * m.n_q);
      if (!close(w->model, one_row(X, row), one_row(Q, row))) return nb::none();
      std::copy(runner.estimate.begin(), runner.estimate.end(), estimates);
      if (!commands.instant(T.data[row], q, V.data + row * m.n)) return nb::none();
      std::copy(commands.memory.held.begin(), commands.memory.held.end(), efforts);
    }
    return nb::make_tuple(first, second);
  }

  // Closes the model at σ(q) from `near`, or at `near` itself; false where only the reference can tell.
  bool close(ReducedModel& model, const In& near, const In& q, bool rho = true) const {
    if (near.given() && !(near.is_vector(m.nq) && on_manifold(near.data))) return false;
    if (!q.given()) return near.given() && model.at(near.data);
    if (!q.is_vector(m.n_q)) return false;
    const double* start = near.given() ? near.data : m.reference.data();
    if (!close_at(model, q.data, [&](const double* x) { return model.sigma(x, start, rho); })) return false;
    return !(near.given() && m.turnable && !model.aligned());
  }

  // The same, and wrenches on links.
  bool close(ReducedModel& model, const In& near, const In& q, const In& wrenches, Pushes& pushes) const {
    return read_pushes(wrenches, m, pushes) && close(model, near, q);
  }

  Pool& pool() { return pool_; }

 private:
  Pool pool_;

  // f(q) with the circles and quaternions of q made exact.
  template <class F> bool close_at(ReducedModel&, const double* q, F&& f) const {
    if (m.plain) return f(q);
    thread_local std::vector<double> unit;
    unit.assign(q, q + m.n_q);
    return normalize(m, unit.data()) && f(unit.data());
  }

  bool on_manifold(const double* q_free) const {
    if (m.nq == m.nv) return true;
    for (const Joint& joint : m.joints) {
      const UnitWindow unit = unit_window(joint.kind);
      if (!unit.size || joint.nq == 0) continue;
      double sum = 0;
      for (int k = 0; k < unit.size; ++k) sum += std::pow(q_free[joint.q + unit.start + k], 2);
      if (!(std::abs(std::sqrt(sum) - 1) <= 5e-7)) return false;
    }
    return true;
  }

  // Reading, velocity, the command held, those on their way (one after the other), how many samples were taken, and what the
  // law has learnt.
  static nb::object memory_of(const Simulation& simulation) {
    if (!simulation.commands()) return nb::none();
    const LoopMemory& memory = simulation.commands()->memory;
    std::vector<double> pending;
    for (const std::vector<double>& u : memory.pending) pending.insert(pending.end(), u.begin(), u.end());
    return nb::make_tuple(array_of(memory.reading), array_of(memory.velocity), array_of(memory.held), array_of(pending),
                          memory.count, array_of(simulation.estimate()));
  }
  static nb::object mode_of(const std::optional<StickSlip>& contact) {
    if (!contact) return nb::none();
    const Friction& mode = contact->mode;
    const auto array = [](const auto& x) { return array_of(std::vector<double>(x.begin(), x.end())); };
    return nb::make_tuple(array(mode.signs), array(mode.rest), array(mode.halted), mode.locked);
  }
  static nb::object array_of(const std::vector<double>& x) {
    double* out;
    nb::object array = new_array({Py_ssize_t(x.size())}, out);
    std::copy(x.begin(), x.end(), out);
    return array;
  }

  nb::object closed(const ReducedModel& model) const {
    double* out;
    nb::object a = new_array({m.nq}, out);
    std::copy(model.q_free.begin(), model.q_free.end(), out);
    return a;
  }
  void write_rho(const ReducedModel& model, double* rho) const {
    std::fill(rho, rho + size_t(m.nv) * m.n, 0.);
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      for (int col = 0; col < c.width(); ++col)
        for (int i = 0; i < c.n(); ++i)
          rho[size_t(c.columns[col]) * m.n + c.independent[i]] = model.states[k].rho[size_t(col) * c.n() + i];
    }
  }
  bool slopes(Workspace& w, const double* v, const double* u, double* dq, double* dv, double* du,
              const Pushes& pushes = {}) const {
    std::vector<double> a(m.n);
    return w.model.forward(v, u, a.data(), pushes) && w.derivatives.forward(v, u, a.data(), dq, dv, du, pushes);
  }

  // The fields of ccpin.dynamics.reduced_model.ReducedTerms, for one state or with a leading axis.
  struct TermsOut {
    static constexpr int fields = 7;
    double* data[fields];
    size_t size[fields];

    nb::object allocate(const Mechanism& m, Py_ssize_t rows = -1) {
      const Py_ssize_t shapes[fields][2] = {{m.nq, 0},     {m.nv, 0},    {m.nv, m.n}, {m.nv, m.n},
                                            {m.n, m.n}, {m.n, m.n}, {m.n, 0}};
      nb::object arrays[fields];
      for (int k = 0; k < fields; ++k) {
        const auto [a, b] = shapes[k];
        const bool vector = k < 2 || k == 6;
        size[k] = size_t(a) * (vector ? 1 : b);
        arrays[k] = rows < 0 ? (vector ? new_array({a}, data[k]) : new_array({a, b}, data[k]))
                             : (vector ? new_array({rows, a}, data[k]) : new_array({rows, a, b}, data[k]));
      }
      return nb::make_tuple(arrays[0], arrays[1], arrays[2], arrays[3], arrays[4], arrays[5], arrays[6]);
    }
    void write(Workspace& w, const double* v, Py_ssize_t row) {
      double* at[fields];
      for (int k = 0; k < fields; ++k) at[k] = data[k] + row * size[k];
      std::copy(w.model.q_free.begin(), w.model.q_free.end(), at[0]);
      w.terms.matrices(v, at[4], at[5], at[2], at[3]);
      w.model.unpack(w.model.v_free, at[1]);
      w.model.gravity(at[6]);
    }
    void blank(const Mechanism&, Py_ssize_t row) {
      for (int k = 0; k < fields; ++k) std::fill_n(data[k] + row * size[k], size[k], NAN);
    }
  };

  // The rows to close, and what all of them are near, closed once (at its own α).
  struct Batch {
    Kernel& kernel;
    In Q;
    ClosedPoint closed;
    bool good = false;
    Batch(Kernel& k, const In& near, const In& rows) : kernel(k), Q(rows) {
      const Mechanism& m = k.m;
      if (!rows.is_matrix(m.n_q) || (near.given() && !(near.is_vector(m.nq) && k.on_manifold(near.data)))) return;
      const double* start = near.given() ? near.data : m.reference.data();
      Pool::Lease w(k.pool_);
      std::vector<double> q(m.n_q);
      w->model.alpha(start, q.data());
      good = w->model.sigma(q.data(), start) && !(near.given() && m.turnable && !w->model.aligned());
      if (good) w->model.remember(closed, true);
    }
    bool close(Workspace& w, Py_ssize_t row) const {
      const double* q = Q.data + row * kernel.m.n_q;
      return In::finite(q, kernel.m.n_q) &&
             kernel.close_at(w.model, q, [&](const double* x) { return w.model.sigma(x, closed); });
    }
  };
  static In one_row(const In& x, Py_ssize_t row) {
    In one;
    one.data = x.data + row * x.size, one.rows = 1, one.size = x.size, one.dimensions = 1;
    return one;
  }
  static bool rows_of(const In& x, Py_ssize_t width, Py_ssize_t rows) { return x.is_matrix(width) && x.rows == rows; }

  template <class F> nb::object with_mask(nb::object arrays, const Batch& batch, int threads, F&& f) {
    bool* mask;
    const nb::object answered = new_array({batch.Q.rows}, mask);
    for_each_row(pool_, batch.Q.rows, threads, [&](Workspace& w, Py_ssize_t k) { mask[k] = f(w, k, batch.close(w, k)); });
    return nb::make_tuple(arrays, answered);
  }
};

// A motion of a kernel's mechanism that is stepped with u held, and told in the coordinates of `home`, its own or another
// kernel of the same mechanism in other coordinates; one thread may use it at a time.
class HeldMotion {
 public:
  HeldMotion(Kernel& kernel, const Kernel& home, nb::dict tableau, double rtol, double atol, double longest,
             double singular, In wrenches, nb::object leaving)
      : kernel_(kernel),
        home_(home),
        space_(kernel.m),
        stepper_(space_, reading::checked([&] { return read_tableau(tableau); }), rtol, atol, longest, singular,
                 pushes_of(wrenches, kernel.m), reading::checked([&] { return read_leaving(leaving, kernel.m); })),
        free_(2 * kernel.m.nv) {
    reading::require(rtol > 0 && atol > 0 && longest > 0, "a tolerance or step is not positive");
    reading::require(home.m.nq == kernel.m.nq && home.m.nv == kernel.m.nv, "the two kernels are of two mechanisms");
    rated_ = !leaving.is_none();
  }

  HeldMotion(const HeldMotion&) = delete;

  // Begin at a closed configuration and velocity; false where only the reference can. `most`: of leverage, infinite where
  // the coordinates are never left.
  bool start(In q_free, In q, In v, double first, double most) {
    ready_ = q.is_vector(kernel_.m.n_q) && v.is_vector(kernel_.m.n) && kernel_.close(space_.model, q_free, In());
    ready_ = ready_ && (most == INFINITY || rated_);
    if (ready_) stepper_.start(q.data, v.data, first, most), certain_.assign(kernel_.m.n_q + kernel_.m.n, 0.);
    return ready_;
  }
  // q, q̇, q̈ of `home`, u, q′, q̇′, |φ| after dt, or after as much of it as a signal let it have: how much, and what the
  // signal's handler raised. None where only the reference can tell, and `start` must come before the next step.
  nb::object step(In u, double dt) {
    const Mechanism &m = kernel_.m, &told = home_.m;
    if (!ready_ || !u.is_vector(m.motors) || !(dt > 0) || !std::isfinite(dt)) return nb::none();
    const bool moved = &kernel_ != &home_;
    {
      nb::gil_scoped_release release;
      ready_ = stepper_.step(u.data, dt) && (!moved || stepper_.free_acceleration(free_.data() + m.nv));
    }
    const nb::object raised = stepper_.signals.raised ? nb::steal(stepper_.signals.raised) : nb::none();
    stepper_.signals.raised = nullptr;
    if (!ready_) {
      if (!raised.is_none()) {  // nobody else would tell
        PyErr_SetObject(reinterpret_cast<PyObject*>(Py_TYPE(raised.ptr())), raised.ptr());
        throw nb::python_error();
      }
      return nb::none();
    }
    stepper_.free_velocity(free_.data());
    const double *x = stepper_.state(), *x_free = space_.model.q_free.data();
    std::copy(x, x + certain_.size(), certain_.begin());
    double *q, *v, *a;
    const nb::object arrays[] = {new_array({told.n_q}, q), new_array({told.n}, v), new_array({told.n}, a)};
    if (moved) {
      read_coordinates(told, {x_free, free_.data(), free_.data() + m.nv}, q, v, a);
    } else {
      std::copy(x, x + m.n_q, q), std::copy(x + m.n_q, x + m.n_q + m.n, v);
      std::copy(stepper_.acceleration(), stepper_.acceleration() + m.n, a);
    }
    for (const nb::object& array : arrays) seal(array);
    return nb::make_tuple(arrays[0], arrays[1], arrays[2], copy(u.data, m.motors), copy(x_free, m.nq),
                          copy(free_.data(), m.nv), space_.model.closure(), stepper_.reached(), raised);
  }
  // (q, q̇) in the kernel's own coordinates after the last step that had an answer.
  nb::object state() const { return copy(certain_.data(), Py_ssize_t(certain_.size())); }
  int evaluations() const { return stepper_.evaluations; }
  double last_step() const { return stepper_.last_step; }

 private:
  Kernel& kernel_;
  const Kernel& home_;
  Workspace space_;
  Stepper stepper_;
  std::vector<double> free_, certain_;
  bool rated_, ready_ = false;  // rated: there are weights to tell poor coordinates by

  static Pushes pushes_of(const In& wrenches, const Mechanism& m) {
    Pushes pushes;
    reading::require(read_pushes(wrenches, m, pushes), "wrenches are not rows of ten numbers");
    return pushes;
  }
  static void seal(const nb::object& array) {
    PyArray_CLEARFLAGS(reinterpret_cast<PyArrayObject*>(array.ptr()), NPY_ARRAY_WRITEABLE);
  }
  static nb::object copy(const double* from, Py_ssize_t count) {
    double* out;
    nb::object array = new_array({count}, out);
    std::copy(from, from + count, out);
    seal(array);
    return array;
  }
};

}  // namespace ccpin
