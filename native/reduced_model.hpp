// The reduced dynamics D q̈ + C q̇ + damping q̇ + g = ρᵀ(Sᵀu + Jᵀw) (22) by recursions over the clusters; springs are part
// of g, wrenches w hang on the bodies.
//
// Each cluster is one joint with n coordinates and many bodies. With X_j = Σ S ρ the twists its coordinates give body j
// from the cluster's carrier, all written in the carrier's frame:
//
//   V_j = V_0 + X_j q̇,    A_j = A_0 + X_j q̈ + (V × s and ρ̇ q̇ terms),    f_j = I_j A_j + V_j ×* I_j V_j + what hangs on j,
//   τ = Σ_j X_jᵀ f_j       (recursive Newton–Euler: Featherstone 2008, table 5.1).
//
// Forward dynamics is the articulated-body algorithm (ibid., table 7.1) with clusters for joints: with I_jᴬ the
// articulated inertia of body j, U = Σ I_jᴬ X_j and D = Σ X_jᵀ I_jᴬ X_j, the carrier feels Σ I_jᴬ − U D⁻¹ Uᵀ and
// Σ f_j + U D⁻¹ (τ − Σ X_jᵀ f_j) (Chignoli et al. 2023). Gravity is an acceleration −g₀ of the world. X_j is not needed for
// it: with Iᶜ_s the sum over what component s of q̇′ moves within the cluster, U = Σ Iᶜ_s S_s ρ_s and D = ρᵀHρ with
// H_st = S_tᵀ Iᶜ_s S_s for each t on the way from s to the carrier (composite rigid bodies, ibid., table 6.2).
#pragma once
#include "parametrization.hpp"
#include "wrenches.hpp"

namespace ccpin {

class ReducedModel : public Parametrization {
 public:
  struct Body {
    RigidInertia Y;
    Motion V, A;
    Force f;                           // what its motion asks for, and what clusters hanging on it pass down
  };
  std::vector<Body> body;              // by joint
  std::vector<Motion> X;               // n twists a joint, from x_offset, after `twists`
  std::vector<int> x_offset;           // by joint
  std::vector<int> offset;             // by cluster: its window of v_free and a_free
  std::vector<double> v_free, a_free;  // q̇′ = ρ q̇ and q̈′ = ρ q̈ + ρ̇ q̇, cluster by cluster
  std::vector<double> tau_free;        // τ′ of the last `inverse`, cluster by cluster
  std::vector<Force> subtree;          // by joint: the wrenches of its subtree within the cluster, likewise

  explicit ReducedModel(const Mechanism& mechanism)
      : Parametrization(mechanism), body(m.joints.size()), x_offset(m.joints.size()), v_free(m.nv), a_free(m.nv),
        tau_free(m.nv), subtree(m.joints.size()), composite_(m.joints.size()), heavy_(m.carries),
        articulated_(m.joints.size()), moved_(m.joints.size()) {
    int columns = 0, x = 0, width = 0, total = 0, scratch = 0;
    for (const Cluster& c : m.clusters) {
      offset.push_back(width), width += c.width();
      d_offset_.push_back(columns), columns += c.n() * c.n();
      n_offset_.push_back(total), total += c.n();
      for (int j : c.joints) {
        x_offset[j] = x, x += c.n();
        for (int s = 0; s < m.joints[j].nv; ++s)
          if (m.joints[j].stiffness || m.joints[j].damping[s])
            passive_.push_back({int(offset.size()) - 1, m.column_of[m.joints[j].v] + s, j, s});
      }
      for (auto j = c.joints.rbegin(); j != c.joints.rend(); ++j)
        if (const int parent = m.joints[*j].parent; parent != c.parent) heavy_[parent] |= heavy_[*j];
      scratch = std::max({scratch, 6 * c.n(), c.width()});
    }
    X.resize(x), D_.resize(columns), tau_.resize(m.n), a_.resize(m.n), U_.resize(m.n), scratch_.resize(scratch);
  }

  // q̈ (22), after `sigma` or `at`, under `load` (n, or null) besides; false where D is not positive definite.
  bool forward(const double* v, const double* u, double* a, const Pushes& pushes = {}, const double* load = nullptr) {
    spread(v);
    move_bodies(true, nullptr);
    push(pushes);
    generalized_force(u, tau_.data());
    for (int i = 0; load && i < m.n; ++i) tau_[i] += load[i];
    for_passive([&](int k, int col, double force) {
      const Cluster& c = m.clusters[k];
      for (int i = 0; i < c.n(); ++i) tau_[c.independent[i]] -= states[k].rho[size_t(col) * c.n() + i] * force;
    });
    for (size_t j = 1; j < m.joints.size(); ++j)
      if (heavy_[j]) articulated_[j] = matrix(body[j].Y);
      else composite_[j] = body[j].Y;
    for (int k = int(m.clusters.size()) - 1; k >= 0; --k)
      if (!articulate(k)) return false;
    for (size_t k = 0; k < m.clusters.size(); ++k) accelerate(int(k), a);
    return true;
  }

  // τ = D q̈ + C q̇ + damping q̇ + g − ρᵀJᵀw, after `sigma` or `at`; a null: q̈ = 0. Leaves the bodies' wrenches and τ′ − Jᵀw.
  void inverse(const double* v, const double* a, double* tau, const Pushes& pushes = {}) {
    spread(v);
    move_bodies(true, a);
    push(pushes);
    for (int k = int(m.clusters.size()) - 1; k >= 0; --k) gather(k, tau, true);
  }

  // g (25), after `sigma` or `at`.
  void gravity_at_rest(double* g) {
    spread(nullptr);
    move_bodies(false, nullptr);
    for (int k = int(m.clusters.size()) - 1; k >= 0; --k) gather(k, g, true);
  }

  // g (25), where the bodies' inertias are those of the last `forward`, `inverse` or `Terms::matrices`.
  void gravity(double* g) {
    for (const Cluster& c : m.clusters) {
      const Motion A0 = carrier_acceleration(c);
      for (int j : c.joints) body[j].A = A0, body[j].f = body[j].Y * A0;
    }
    for (int k = int(m.clusters.size()) - 1; k >= 0; --k) gather(k, g, false);
  }

  // λ (17) with φ_q′ᵀ λ = τ′ − Sᵀu − Jᵀw, global rows; after `inverse` at the true acceleration.
  void multipliers(const double* u, double* lambda) {
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      const ClusterState& s = states[k];
      const auto from = tau_free.begin() + offset[k];
      std::vector<double> tau(from, from + c.width()), f(c.unknowns()), x(c.rows());
      subtract_efforts(c, s, u, tau);
      for (int i = 0; i < c.unknowns(); ++i) f[i] = tau[c.dependent[i]];
      s.factor.solve_transposed(f.data(), x.data());
      int row = 0;
      for (int i : c.loops)
        for (int r = 0; r < m.loops[i].size; ++r) lambda[m.loops[i].row + r] = x[row++];
      for (int i : c.couplings) lambda[m.couplings[i].row] = x[row++];
    }
  }

  // Kinetic energy ½ q̇ᵀD q̇ and potential energy V with ∂V/∂q = g.
  struct Energy { double kinetic, potential; };
  Energy energy(const double* v) {
    spread(v);
    move_bodies(false, nullptr);
    Energy e{0, 0};
    std::vector<Pose> world(m.joints.size());
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      for (int j : c.joints) {
        world[j] = world[c.parent] * pose[j];
        e.kinetic += 0.5 * dot(body[j].Y * body[j].V, body[j].V);
        e.potential -= m.joints[j].mass * m.gravity.dot(world[j].p + world[j].R * m.joints[j].centre);
        if (const Joint& joint = m.joints[j]; joint.stiffness)
          e.potential += 0.5 * joint.stiffness * std::pow(q_free[joint.q] - joint.rest, 2);
      }
      for_armature(c, [&](int col, double arm) { e.kinetic += 0.5 * arm * std::pow(v_free[offset[k] + col], 2); });
    }
    return e;
  }

  // ρᵀSᵀ into rows of a given stride that hold zeros.
  void transmission(double* out, int stride) const {
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      for (int i = 0; i < c.n(); ++i) {
        double* row = out + size_t(c.independent[i]) * stride;
        if (m.direct) row[c.independent[i]] = 1;
        for (size_t r = 0; r < c.motors.size(); ++r)
          row[c.motors[r]] = c.gears[r] * states[k].rho[size_t(c.motor_columns[r]) * c.n() + i];
      }
    }
  }

  // From the packed order of clusters to the order of q̇′.
  void unpack(const std::vector<double>& packed, double* out) const {
    for (size_t k = 0; k < m.clusters.size(); ++k)
      for (int col = 0; col < m.clusters[k].width(); ++col) out[m.clusters[k].columns[col]] = packed[offset[k] + col];
  }

  // q̇′ in its own order, after `forward` or `spread`.
  void free_velocity(double* out) const { unpack(v_free, out); }
  // q̈′ = ρ q̈ + ρ̇ q̇ in the order of q̇′, a being what the last `forward` gave.
  void free_acceleration(const double* a, double* out) const {
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      const ClusterState& s = states[k];
      for (int col = 0; col < c.width(); ++col) {
        double sum = s.bias[col];
        for (int i = 0; i < c.n(); ++i) sum += s.rho[size_t(col) * c.n() + i] * a[c.independent[i]];
        out[c.columns[col]] = sum;
      }
    }
  }

  // q̇′ = ρ q̇ (v null: zero).
  void spread(const double* v) {
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      for (int col = 0; col < c.width(); ++col) {
        double sum = 0;
        if (v)
          for (int i = 0; i < c.n(); ++i) sum += states[k].rho[size_t(col) * c.n() + i] * v[c.independent[i]];
        v_free[offset[k] + col] = sum;
      }
    }
  }

  // Inertias, V, A and the wrenches they ask for. `moving`: with ρ̇ q̇; a null: q̈ = 0.
  void move_bodies(bool moving, const double* a) {
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      ClusterState& s = states[k];
      const int n = c.n();
      const double* v = v_free.data() + offset[k];
      double* acceleration = a_free.data() + offset[k];
      if (moving) bias(c, s, v);
      else travel(c, v), std::fill(s.bias.begin(), s.bias.end(), 0.);
      for (int col = 0; col < c.width(); ++col) {
        acceleration[col] = s.bias[col];
        if (a)
          for (int i = 0; i < n; ++i) acceleration[col] += s.rho[size_t(col) * n + i] * a[c.independent[i]];
      }
      const Motion V0 = carrier_velocity(c);
      accelerate_bodies(c, carrier_acceleration(c), acceleration);
      for (int j : c.joints) {  // A = A₀ + V₀ × (V − V₀) + the cluster's own
        Body& b = body[j];
        b.V = relative[j].V, b.A = moved_[j] + relative[j].A;
        if (c.parent) b.A += cross(V0, b.V), b.V += V0;
        b.Y = inertia_of(j);
        b.f = b.Y * b.A + cross(b.V, b.Y * b.V);
      }
    }
  }

  // X of every body, after `sigma` or `at`: that of the joint's parent and its own columns'.
  void twists() {
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      const int n = c.n();
      for (int j : c.joints) {
        const Joint& joint = m.joints[j];
        Motion* twist = X.data() + x_offset[j];
        const Motion* parent = joint.parent == c.parent ? nullptr : X.data() + x_offset[joint.parent];
        for (int i = 0; i < n; ++i) twist[i] = parent ? parent[i] : Motion();
        for (int l = 0; l < joint.nv; ++l) {
          const double* rho = states[k].rho.data() + size_t(m.column_of[joint.v] + l) * n;
          for (int i = 0; i < n; ++i) twist[i] += S[joint.v + l] * rho[i];
        }
      }
    }
  }

  // Takes what wrenches on links give from what the bodies' motion asks for.
  void push(const Pushes& pushes) {
    for (const Push& w : pushes) body[w.joint].f += wrench(carried(*this, w)) * -1;
  }

  // The velocity and acceleration of the body that carries a cluster, in its own frame.
  Motion carrier_velocity(const Cluster& c) const {
    return c.parent ? in_frame(pose[c.parent], body[c.parent].V) : Motion();
  }
  Motion carrier_acceleration(const Cluster& c) const {
    return c.parent ? in_frame(pose[c.parent], body[c.parent].A) : Motion{-m.gravity, Vec3::Zero()};
  }

  // What spring and, where moving, damper of a joint take at its component s: k (θ − θ₀) + b q̇′.
  double passive(const Joint& joint, int s, double rate) const {
    const double spring = joint.stiffness ? joint.stiffness * (q_free[joint.q] - joint.rest) : 0;
    return spring + joint.damping[s] * rate;
  }

  // The same of every component that has either, with its cluster and column.
  template <class F> void for_passive(F&& f) const {
    for (const Passive& p : passive_)
      f(p.cluster, p.column, passive(m.joints[p.joint], p.component, v_free[offset[p.cluster] + p.column]));
  }

  // Adds ρᵀB′ρ v.
  void damp(const double* v, double* out) const {
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      for (int j : c.joints)
        for (int s = 0; s < m.joints[j].nv; ++s) {
          if (m.joints[j].damping[s] == 0) continue;
          const double* rho = &states[k].rho[size_t(m.column_of[m.joints[j].v] + s) * c.n()];
          double rate = 0;
          for (int i = 0; i < c.n(); ++i) rate += rho[i] * v[c.independent[i]];
          for (int i = 0; i < c.n(); ++i) out[c.independent[i]] += rho[i] * m.joints[j].damping[s] * rate;
        }
    }
  }

  template <class F> void for_armature(const Cluster& c, F&& f) const {
    for (int j : c.joints)
      for (int s = 0; s < m.joints[j].nv; ++s)
        if (m.joints[j].armature[s] != 0) f(m.column_of[m.joints[j].v] + s, m.joints[j].armature[s]);
  }

 private:
  struct Passive { int cluster, column, joint, component; };
  std::vector<Passive> passive_;               // components with a spring or a damper
  std::vector<double> D_, tau_, a_, scratch_;  // D of each cluster, then its Cholesky factor; ρᵀSᵀu; q̈ cluster by cluster
  std::vector<Force> U_;                       // n a cluster
  std::vector<RigidInertia> composite_;        // by joint: Iᶜ, where no other cluster hangs on what it moves
  std::vector<char> heavy_;                    // by joint: whether one does
  std::vector<Mat6, Eigen::aligned_allocator<Mat6>> articulated_;  // then Iᶜ, of articulated inertias
  std::vector<Motion> moved_;                  // what a body's acceleration gains by its carrier's and by Σ S q̈′
  std::vector<int> d_offset_, n_offset_;

  // `moved_` of a cluster's bodies, where their carrier gains A0 and the cluster's components of q̈′ (local columns) are a.
  void accelerate_bodies(const Cluster& c, const Motion& A0, const double* a) {
    for (int j : c.joints) {
      const int parent = m.joints[j].parent;
      moved_[j] = (parent == c.parent ? A0 : moved_[parent]) + own(j, a);
    }
  }

  RigidInertia inertia_of(int j) const {
    const Joint& joint = m.joints[j];
    RigidInertia Y;
    const Vec3 centre = pose[j].p + pose[j].R * joint.centre;
    Y.m = joint.mass;
    Y.h = joint.mass * centre;
    const Mat3 turned = pose[j].R * joint.inertia;
    const double square = joint.mass * centre.squaredNorm();
    for (int r = 0; r < 3; ++r)
      for (int k = 0; k <= r; ++k)
        Y.I(r, k) = Y.I(k, r) = turned.row(r).dot(pose[j].R.row(k)) - Y.h[r] * centre[k] + (r == k ? square : 0);
    return Y;
  }

  // τ′ = Sᵀ (subtree's wrench) and τ = ρᵀτ′ of one cluster, and the sum of its wrenches to its carrier.
  void gather(int k, double* tau, bool rotors) {
    const Cluster& c = m.clusters[k];
    const int n = c.n();
    Force passed;
    for (int j : c.joints) subtree[j] = body[j].f;
    for (int i = 0; i < n; ++i) tau[c.independent[i]] = 0;
    for (auto j = c.joints.rbegin(); j != c.joints.rend(); ++j) {
      const Joint& joint = m.joints[*j];
      for (int s = 0; s < joint.nv; ++s) {
        const int col = m.column_of[joint.v] + s;
        double& effort = tau_free[offset[k] + col];
        effort = dot(subtree[*j], S[joint.v + s]);
        if (rotors) effort += joint.armature[s] * a_free[offset[k] + col];
        effort += passive(joint, s, rotors ? v_free[offset[k] + col] : 0);
        for (int i = 0; i < n; ++i) tau[c.independent[i]] += states[k].rho[size_t(col) * n + i] * effort;
      }
      (joint.parent == c.parent ? passed : subtree[joint.parent]) += subtree[*j];
    }
    if (c.parent) body[c.parent].f += out_of_frame(pose[c.parent], passed);
  }

  // The articulated-body step of one cluster, children's done: D, U, τ − Σ X_jᵀ f_j solved, and the carrier's share.
  bool articulate(int k) {
    const Cluster& c = m.clusters[k];
    const int n = c.n();
    double *D = D_.data() + d_offset_[k], *t = a_.data() + n_offset_[k];
    Force passed, *U = U_.data() + n_offset_[k];
    Mat6 inertia = Mat6::Zero();
    RigidInertia light;
    std::fill(D, D + n * n, 0.), std::fill(U, U + n, Force());
    for (int i = 0; i < n; ++i) t[i] = tau_[c.independent[i]];
    for (auto j = c.joints.rbegin(); j != c.joints.rend(); ++j) {
      const Joint& joint = m.joints[*j];
      with_width(n, [&](auto width) {
        for (int s = 0; s < joint.nv; ++s) add_component(c, k, *j, s, width, D, t, U);
      });
      if (joint.parent != c.parent) {
        body[joint.parent].f += body[*j].f;
        if (!heavy_[joint.parent]) composite_[joint.parent] += composite_[*j];
        else articulated_[joint.parent] += heavy_[*j] ? articulated_[*j] : matrix(composite_[*j]);
      } else if (c.parent) {
        passed += body[*j].f;
        if (heavy_[*j]) inertia += articulated_[*j];
        else light += composite_[*j];
      }
    }
    for (int i = 0; i < n; ++i)
      for (int l = 0; l <= i; ++l) D[i * n + l] += D[l * n + i];
    if (!cholesky(D, n)) return false;
    cholesky_solve(D, n, t, 1);
    if (!c.parent) return true;
    inertia += matrix(light);
    for (int i = 0; i < n; ++i) Eigen::Map<Vec6>{scratch_.data() + i * 6} = vector(U[i]);  // then D⁻¹ Uᵀ, n × 6
    cholesky_solve(D, n, scratch_.data(), 6);
    for (int i = 0; i < n; ++i) {
      inertia.noalias() -= vector(U[i]) * Eigen::Map<Eigen::Matrix<double, 1, 6>>(scratch_.data() + i * 6);
      passed += U[i] * t[i];
    }
    articulated_[c.parent] += out_of_frame(pose[c.parent], inertia);
    body[c.parent].f += out_of_frame(pose[c.parent], passed);
    return true;
  }

  // What one component s of a joint adds to τ − ρᵀSᵀf, to U, and to Σ ρ_s (½ H_ss ρ_s + Σ H_st ρ_t)ᵀ (t on the way from s to
  // the carrier), which D is with its transpose.
  template <class N> void add_component(const Cluster& c, int k, int j, int s, N width, double* D, double* t, Force* U) {
    const Joint& joint = m.joints[j];
    const auto n = width;
    const int col = m.column_of[joint.v] + s;
    const double *all = states[k].rho.data(), *rho = all + size_t(col) * n, arm = joint.armature[s];
    const Motion& own = S[joint.v + s];
    const Force F = heavy_[j] ? apply(articulated_[j], own) : composite_[j] * own;
    const double half = 0.5 * (dot(F, own) + arm), effort = dot(body[j].f, own) + arm * states[k].bias[col];
    double* __restrict y = scratch_.data();
    for (int i = 0; i < n; ++i) y[i] = half * rho[i];
    for (int before = j, end = s; before != c.parent; before = m.joints[before].parent, end = m.joints[before].nv) {
      const double* other = all + size_t(m.column_of[m.joints[before].v]) * n;
      for (int l = 0; l < end; ++l, other += n) {
        const double H = dot(F, S[m.joints[before].v + l]);
        for (int i = 0; i < n; ++i) y[i] += H * other[i];
      }
    }
    for (int i = 0; i < n; ++i, D += n) {
      for (int l = 0; l < n; ++l) D[l] += rho[i] * y[l];
      t[i] -= rho[i] * effort;
    }
    if (c.parent)
      for (int i = 0; i < n; ++i) U[i] += F * rho[i];
  }

  // q̈ of one cluster, its carrier's acceleration known: D⁻¹(τ − Σ X_jᵀ f_j − Uᵀ A₀).
  void accelerate(int k, double* a) {
    const Cluster& c = m.clusters[k];
    const int n = c.n();
    double* t = a_.data() + n_offset_[k];
    Motion moved;
    if (c.parent) {
      moved = in_frame(pose[c.parent], moved_[c.parent]);
      for (int i = 0; i < n; ++i) scratch_[i] = dot(U_[n_offset_[k] + i], moved);
      cholesky_solve(D_.data() + d_offset_[k], n, scratch_.data(), 1);
      for (int i = 0; i < n; ++i) t[i] -= scratch_[i];
    }
    for (int i = 0; i < n; ++i) a[c.independent[i]] = t[i];
    if (!c.carries) return;
    for (int col = 0; col < c.width(); ++col) {
      const double* rho = states[k].rho.data() + size_t(col) * n;
      scratch_[col] = 0;
      for (int i = 0; i < n; ++i) scratch_[col] += rho[i] * t[i];
    }
    accelerate_bodies(c, moved, scratch_.data());
  }

  // ρᵀSᵀu.
  void generalized_force(const double* u, double* tau) {
    if (m.direct) {
      std::copy(u, u + m.n, tau);
      return;
    }
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      for (int i = 0; i < c.n(); ++i) {
        double sum = 0;
        for (size_t r = 0; r < c.motors.size(); ++r)
          sum += states[k].rho[size_t(c.motor_columns[r]) * c.n() + i] * c.gears[r] * u[c.motors[r]];
        tau[c.independent[i]] = sum;
      }
    }
  }

  // τ′ − Sᵀu, with Sᵀu = α_q′ᵀ u where u acts on q itself.
  void subtract_efforts(const Cluster& c, const ClusterState& s, const double* u, std::vector<double>& tau) const {
    if (!m.direct) {
      for (size_t i = 0; i < c.motors.size(); ++i) tau[c.motor_columns[i]] -= c.gears[i] * u[c.motors[i]];
      return;
    }
    const size_t direct = c.direct.size();
    for (size_t i = 0; i < direct; ++i) tau[c.direct[i]] -= u[c.independent[i]];
    for (size_t i = direct; i < size_t(c.n()); ++i)
      for (int col = 0; col < c.width(); ++col)
        tau[col] -= s.J[(c.phi_rows() + i - direct) * c.width() + c.place[col]] * u[c.independent[i]];
  }
};

}  // namespace ccpin
