// ∂τ/∂q, ∂τ/∂q̇ and D = ∂τ/∂q̈ of τ = D q̈ + C q̇ + damping q̇ + g, exact, by recursion over the clusters; ∂q̈ follows from them.
//
// Along a tangent step q_k of a cluster's own coordinates, seen from each body j (so that what is fixed in j is held),
// with i its parent, ξ_jk = X_jk − X_ik, s = S q̇′ and A′ standing for dA + V × dV,
//
//   dV_j = dV_i + V_i × ξ_jk + S ∂(ρ q̇),      dA′_j = dA′_i + V_i × (dV_j − dV_i) + A_i × ξ_jk + V_j × S ∂(ρ q̇) + S ∂q̈′,
//   dF_j = X_jk ×* F_j + I_j dA′_j + 2 B_j dV_j,
//
// where F_j is the wrench of j and of all clusters it carries, I_j and B_j their composite inertia and Coriolis map. A
// change of the carrier's motion changes dV and dA′ of all its cluster's bodies alike. Since τ = ρᵀτ′ and
// (∂ρ_i/∂q_k)ᵀτ′ = −μᵀ D_k(ψ_q′ ρ_i) with ψ_q′ᵀμ = τ′,
//
//   ∂τ_i/∂q_k = Σ_j [X_ji·dF_jk − ξ_ji·(X_jk ×* Fˢ_j)] − μᵀ D_k(ψ_q′ ρ_i),      Fˢ: of j's subtree within the cluster,
//
// with, for a wrench w that is constant in the world, the change of −w that fixing it in j leaves out (wrenches.hpp)
// (Carpentier and Mansard, 2018; Echeandia and Wensing, 2021, with clusters for joints). ∂(ρ q̇) and ∂q̈′ solve
// ψ_q′ ∂(ρ q̇) = −D(ψ_q′ q̇′) and ψ_q′ ∂q̈′ = −D(ψ_q′ q̈′ + ψ̇_q′ q̇′) as in ccpin.kinematics.sigma_derivatives.
#pragma once
#include "loop_derivatives.hpp"
#include "terms.hpp"

namespace ccpin {

class Derivatives {
 public:
  explicit Derivatives(ReducedModel& model)
      : r_(model), m_(model.m), bodies_(m_.joints.size()), dV_(model.X.size()),
        dA_(model.X.size()), dA_by_v_(model.X.size()), by_q_(model.X.size()), by_v_(model.X.size()), by_a_(model.X.size()),
        multipliers_(m_.clusters.size()), dv_(m_.clusters.size()),
        da_(m_.clusters.size()) {
    for (size_t k = 0; k < m_.clusters.size(); ++k) {
      const Cluster& c = m_.clusters[k];
      most_ = std::max<size_t>(most_, c.n());
      multipliers_[k].resize(c.rows());
      dv_[k].assign(size_t(c.width()) * c.n(), 0.), da_[k].assign(size_t(c.width()) * c.n() * 2, 0.);
    }
    P_.resize(most_), Pv_.resize(most_), U_.resize(most_), H_.resize(most_), K_.resize(most_), tau_.resize(m_.n);
  }

  // ∂τ/∂q, ∂τ/∂q̇ and D, each n × n, after `sigma` or `at`. u given: of τ − ρᵀSᵀu at fixed u instead.
  void generalized_force(const double* v, const double* a, const double* u, double* dq, double* dv, double* D,
                         const Pushes& pushes = {}) {
    const size_t size = size_t(m_.n) * m_.n;
    std::fill(dq, dq + size, 0.), std::fill(dv, dv + size, 0.), std::fill(D, D + size, 0.);
    r_.inverse(v, a, tau_.data(), pushes);
    r_.twists();
    hang(pushes);
    for (size_t j = 1; j < m_.joints.size(); ++j) bodies_[j] = Composite(r_.body[j].Y, r_.body[j].V);
    for (size_t k = 0; k < m_.clusters.size(); ++k) {
      find_multipliers(int(k), u);
      change_velocities(int(k));
      change_accelerations(int(k));
      change_bodies(int(k));
    }
    for (int k = int(m_.clusters.size()) - 1; k >= 0; --k) {
      change_forces(int(k), dq, dv, D);
      change_rho(int(k), dq);
      rotors(int(k), dq, dv, D);
      springs_and_dampers(int(k), dq, dv);
      if (m_.clusters[k].parent) pass_down(m_.clusters[k], dq, dv, D);
    }
  }

  // ∂q̈/∂q, ∂q̈/∂q̇ (n × n) and ∂q̈/∂u = D⁻¹ρᵀSᵀ (n × motors), given q̈ = a at (v, u); false where D is singular.
  bool forward(const double* v, const double* u, const double* a, double* da_dq, double* da_dv, double* da_du,
               const Pushes& pushes = {}) {
    const int n = m_.n, width = 2 * n + m_.motors;
    D_.resize(size_t(n) * n), right_.assign(size_t(n) * width, 0.), slopes_.resize(size_t(n) * n * 2);
    double *dq = slopes_.data(), *dv = dq + size_t(n) * n;
    generalized_force(v, a, m_.direct ? nullptr : u, dq, dv, D_.data(), pushes);
    for (int i = 0; i < n; ++i) {
      double* row = right_.data() + size_t(i) * width;
      for (int k = 0; k < n; ++k) row[k] = -dq[i * n + k], row[n + k] = -dv[i * n + k];
    }
    r_.transmission(right_.data() + 2 * n, width);
    if (!cholesky(D_.data(), n)) return false;
    cholesky_solve(D_.data(), n, right_.data(), width);
    for (int i = 0; i < n; ++i) {
      const double* row = right_.data() + size_t(i) * width;
      std::copy(row, row + n, da_dq + size_t(i) * n);
      std::copy(row + n, row + 2 * n, da_dv + size_t(i) * n);
      std::copy(row + 2 * n, row + width, da_du + size_t(i) * m_.motors);
    }
    return true;
  }

 private:
  ReducedModel& r_;
  const Mechanism& m_;
  std::vector<Composite> bodies_;                          // by joint
  std::vector<CoriolisMap> turning_;                       // by joint, of wrenches on it and what it carries; empty: none
  std::vector<Motion> dV_, dA_, dA_by_v_;                  // dV and dA′, n a joint, from x_offset
  std::vector<std::vector<double>> multipliers_;           // μ by cluster, on ψ's rows
  std::vector<std::vector<double>> dv_, da_;               // ∂(ρ q̇)/∂q (width × n); ∂q̈′ by q, then by q̇ (width × 2n)
  std::vector<Force> by_q_, by_v_, by_a_;                  // dF by q, q̇ and q̈ over a subtree, n a joint
  std::vector<Force> P_, Pv_, U_, H_, K_;                  // what leaves a cluster downwards
  std::vector<double> tau_, D_, right_, slopes_;
  std::vector<RowSlope> row_slopes_;
  std::vector<Row> step_rates_;
  size_t most_ = 0;

  double& entry(double* matrix, int row, int col) const { return matrix[size_t(row) * m_.n + col]; }

  // Σ S x over a joint's own components, x one column of a matrix on local columns; null: zero.
  Motion own(int j, const double* x, int stride) const {
    const Joint& joint = m_.joints[j];
    Motion s;
    if (x)
      for (int k = 0; k < joint.nv; ++k) s += r_.S[joint.v + k] * x[size_t(m_.column_of[joint.v] + k) * stride];
    return s;
  }
  const Motion* twists(int j) const { return r_.X.data() + r_.x_offset[j]; }
  Motion step_of(const Cluster& c, int j, int k) const {  // ξ_jk
    const int parent = m_.joints[j].parent;
    return parent == c.parent ? twists(j)[k] : twists(j)[k] - twists(parent)[k];
  }

  void hang(const Pushes& pushes) {
    turning_.assign(pushes.empty() ? 0 : m_.joints.size(), CoriolisMap());
    for (const Push& w : pushes) turning_[w.joint] += turning(carried(r_, w));
  }

  void find_multipliers(int k, const double* u) {
    const Cluster& c = m_.clusters[k];
    const auto from = r_.tau_free.begin() + r_.offset[k];
    std::vector<double> tau(from, from + c.width()), f(c.unknowns());
    for (size_t i = 0; u && i < c.motors.size(); ++i) tau[c.motor_columns[i]] -= c.gears[i] * u[c.motors[i]];
    for (int i = 0; i < c.unknowns(); ++i) f[i] = tau[c.dependent[i]];
    r_.states[k].factor.solve_transposed(f.data(), multipliers_[k].data());
  }

  // ψ_q′ ∂(ρ q̇)/∂q_k = −D_k(ψ_q′ q̇′).
  void change_velocities(int k) {
    const Cluster& c = m_.clusters[k];
    ClusterState& s = r_.states[k];
    const int n = c.n();
    slopes(k, s.rho.data(), nullptr, [&](int row, int i, const RowSlope& x) { s.right[row * n + i] = -x.rate; });
    s.factor.solve(s.right.data(), n);
    Parametrization::scatter(c, s.right.data(), n, dv_[k].data());
  }

  // ψ_q′ ∂q̈′ = −D(ψ_q′ q̈′ + ψ̇_q′ q̇′) along (ρ_k, ∂(ρ q̇)/∂q_k), then along (0, ρ_k).
  void change_accelerations(int k) {
    const Cluster& c = m_.clusters[k];
    ClusterState& s = r_.states[k];
    const int n = c.n();
    double* right = s.right.data();
    slopes(k, s.rho.data(), dv_[k].data(), [&](int row, int i, const RowSlope& x) { right[row * 2 * n + i] = -x.second; });
    slopes(k, nullptr, s.rho.data(), [&](int row, int i, const RowSlope& x) { right[row * 2 * n + n + i] = -x.second; });
    s.factor.solve(right, 2 * n);
    Parametrization::scatter(c, right, 2 * n, da_[k].data());
  }

  // The slopes of every row of a cluster along its n directions (step, dv), columns of matrices on its local columns
  // (null: zero): give(row, direction, slope).
  template <class G> void slopes(int k, const double* step, const double* dv, G&& give) {
    const Cluster& c = m_.clusters[k];
    const double *v = r_.v_free.data() + r_.offset[k], *a = r_.a_free.data() + r_.offset[k];
    const int n = c.n();
    const auto column = [](const double* matrix, int i) { return matrix ? matrix + i : nullptr; };
    int row = 0;
    for (int l : c.loops) {
      const Loop& loop = m_.loops[l];
      const Ends ends = r_.ends(loop);
      row_slopes_.resize(std::max<size_t>(row_slopes_.size(), loop.size));
      for (int i = 0; i < n; ++i) {
        BodyJet on[2];
        for (int side = 0; side < 2; ++side)
          for (int j : side ? loop.path_b : loop.path_a)
            on[side].advance(own(j, v, 1), own(j, a, 1), own(j, column(step, i), n), own(j, column(dv, i), n));
        loop_row_slopes(loop, ends, on[0], on[1], row_slopes_.data());
        for (int r = 0; r < loop.size; ++r) give(row + r, i, row_slopes_[r]);
      }
      row += loop.size;
    }
    const auto at = [n](const double* x, int col, int i) { return x ? x[size_t(col) * n + i] : 0.; };
    for (int l : c.couplings) {
      for (int i = 0; i < n; ++i) {
        RowSlope sum{0, 0};
        for (const CouplingTerm& t : m_.couplings[l].terms) {
          const int col = m_.column_of[t.v];
          const double second = slope(t, r_.q_free.data(), 2), third = slope(t, r_.q_free.data(), 3);
          const double dq = at(step, col, i), change = at(dv, col, i);
          sum.rate += second * v[col] * dq + slope(t, r_.q_free.data(), 1) * change;
          sum.second += (second * a[col] + third * v[col] * v[col]) * dq + 2 * second * v[col] * change;
        }
        give(row, i, sum);
      }
      ++row;
    }
    for (int l : c.components) {
      const Coordinate& coordinate = m_.coordinates[l];
      const Joint& joint = m_.joints[coordinate.joint];
      const int first = m_.column_of[joint.v];
      for (int i = 0; i < n; ++i) {
        double dq[6], change[6];
        for (int s = 0; s < joint.nv; ++s) dq[s] = at(step, first + s, i), change[s] = at(dv, first + s, i);
        give(row, i, component_slope(coordinate, r_.q_free.data() + joint.q, v + first, a + first, dq, change));
      }
      ++row;
    }
  }

  // dV, dA′ by q and dA′ by q̇ (whose dV is X) of one cluster's bodies, their carrier's motion held.
  void change_bodies(int k) {
    const Cluster& c = m_.clusters[k];
    const int n = c.n();
    const Motion V0 = r_.carrier_velocity(c), A0 = r_.carrier_acceleration(c);
    for (int j : c.joints) {
      const int parent = m_.joints[j].parent;
      const bool first = parent == c.parent;
      const Motion &V = first ? V0 : r_.body[parent].V, &A = first ? A0 : r_.body[parent].A, &Vj = r_.body[j].V;
      for (int i = 0; i < n; ++i) {
        const int at = r_.x_offset[j] + i, from = r_.x_offset[parent] + i;
        const Motion step = step_of(c, j, i), ds = own(j, dv_[k].data() + i, n), gain = cross(V, step) + ds;
        dV_[at] = gain;
        dA_[at] = cross(V, gain) + cross(A, step) + cross(Vj, ds) + own(j, da_[k].data() + i, 2 * n);
        dA_by_v_[at] = cross(V + Vj, step) + own(j, da_[k].data() + n + i, 2 * n);
        if (!first) dV_[at] += dV_[from], dA_[at] += dA_[from], dA_by_v_[at] += dA_by_v_[from];
      }
    }
  }

  // Σ X·dF and the rest of ρᵀ∂τ′ of one cluster, its children's done, and what leaves it downwards.
  void change_forces(int k, double* dq, double* dv, double* D) {
    const Cluster& c = m_.clusters[k];
    const int n = c.n();
    for (int i = 0; i < n; ++i) P_[i] = Pv_[i] = U_[i] = H_[i] = K_[i] = Force();
    for (int j : c.joints) {
      const auto& [I, B] = bodies_[j];
      for (int at = r_.x_offset[j], i = 0; i < n; ++i, ++at) {
        const Motion& X = r_.X[at];
        by_q_[at] = cross(X, r_.body[j].f) + I * dA_[at] + B * (dV_[at] * 2);
        by_v_[at] = I * dA_by_v_[at] + B * (X * 2), by_a_[at] = I * X;
        if (c.parent) H_[i] += B.transposed(X) * 2;
        if (turning_.empty()) continue;
        by_q_[at] += turning_[j] * X;
        K_[i] += turning_[j].transposed(X);
      }
    }
    for (auto j = c.joints.rbegin(); j != c.joints.rend(); ++j) {
      const Joint& joint = m_.joints[*j];
      const bool first = joint.parent == c.parent;
      for (int i = 0; i < n; ++i) {
        const int at = r_.x_offset[*j] + i, below = first ? 0 : r_.x_offset[joint.parent] + i;
        const Force turned = by_q_[at] - cross(r_.X[at], r_.subtree[*j]);
        for (int s = 0; s < joint.nv; ++s) {
          const Motion& column = r_.S[joint.v + s];
          const double* rho = r_.states[k].rho.data() + size_t(m_.column_of[joint.v] + s) * n;
          const double x = dot(turned, column), y = dot(by_v_[at], column), z = dot(by_a_[at], column);
          for (int l = 0; l < n; ++l) {
            const int row = c.independent[l], col = c.independent[i];
            entry(dq, row, col) += rho[l] * x, entry(dv, row, col) += rho[l] * y, entry(D, row, col) += rho[l] * z;
          }
        }
        (first ? P_[i] : by_q_[below]) += by_q_[at];
        (first ? Pv_[i] : by_v_[below]) += by_v_[at];
        (first ? U_[i] : by_a_[below]) += by_a_[at];
      }
    }
    if (c.parent) carry(c, r_.pose[c.parent], bodies_);
    if (!c.parent || turning_.empty()) return;
    for (int j : c.joints) turning_[c.parent] += out_of_frame(r_.pose[c.parent], turning_[j]);
  }

  // −μᵀ D_k(ψ_q′ ρ_i) of one cluster.
  void change_rho(int k, double* dq) {
    const Cluster& c = m_.clusters[k];
    const ClusterState& s = r_.states[k];
    const double* mu = multipliers_[k].data();
    const int n = c.n();
    int row = 0;
    for (int i : c.loops) {
      change_loop(c, s, m_.loops[i], mu, row, dq);
      row += m_.loops[i].size;
    }
    for (int i : c.couplings) {
      for (const CouplingTerm& t : m_.couplings[i].terms) {
        const double second = mu[row] * slope(t, r_.q_free.data(), 2);
        const double* rho = s.rho.data() + size_t(m_.column_of[t.v]) * n;
        for (int l = 0; l < n; ++l)
          for (int o = 0; o < n; ++o) entry(dq, c.independent[l], c.independent[o]) -= second * rho[l] * rho[o];
      }
      ++row;
    }
    for (int i : c.components) {
      const Coordinate& coordinate = m_.coordinates[i];
      const Joint& joint = m_.joints[coordinate.joint];
      const double* rho = s.rho.data() + size_t(m_.column_of[joint.v]) * n;
      for (int o = 0; o < n; ++o) {
        double step[6], unused[6], rate[6];
        for (int t = 0; t < joint.nv; ++t) step[t] = rho[size_t(t) * n + o];
        component_row(coordinate, r_.q_free.data() + joint.q, step, unused, rate);
        for (int l = 0; l < n; ++l)
          for (int t = 0; t < joint.nv; ++t)
            entry(dq, c.independent[l], c.independent[o]) -= mu[row] * rate[t] * rho[size_t(t) * n + l];
      }
      ++row;
    }
  }

  // The share of one loop: with W = Σ μ W_r on an end, D_k(W·V) = D_k W · X_i + W · Σ X_jk × ξ_ji over its path.
  void change_loop(const Cluster& c, const ClusterState& s, const Loop& loop, const double* mu, int row, double* dq) {
    const int n = c.n();
    const Ends ends = r_.ends(loop);
    step_rates_.resize(std::max<size_t>(step_rates_.size(), loop.size));
    Row W;
    for (int r = 0; r < loop.size; ++r) W.a += s.rows[row + r].a * mu[row + r], W.b += s.rows[row + r].b * mu[row + r];
    const auto relative = [&](int j, int i) {  // X from the ancestor C
      if (j == loop.ancestor) return Motion();
      return loop.ancestor == loop.base ? twists(j)[i] : twists(j)[i] - twists(loop.ancestor)[i];
    };
    for (int o = 0; o < n; ++o) {
      loop_row_rates(loop, ends, relative(loop.a, o), relative(loop.b, o), step_rates_.data());
      Row dW;
      for (int r = 0; r < loop.size; ++r)
        dW.a += step_rates_[r].a * mu[row + r], dW.b += step_rates_[r].b * mu[row + r];
      for (int l = 0; l < n; ++l)
        entry(dq, c.independent[l], c.independent[o]) -= dot(dW.a, relative(loop.a, l)) + dot(dW.b, relative(loop.b, l));
      for (int side = 0; side < 2; ++side)
        for (int j : side ? loop.path_b : loop.path_a) {
          const Force turned = cross(relative(j, o), side ? W.b : W.a);  // W·(X × ξ) = −(X ×* W)·ξ
          for (int l = 0; l < n; ++l) entry(dq, c.independent[l], c.independent[o]) += dot(turned, step_of(c, j, l));
        }
    }
  }

  void rotors(int k, double* dq, double* dv, double* D) {
    const Cluster& c = m_.clusters[k];
    const int n = c.n();
    r_.for_armature(c, [&](int col, double arm) {
      const double *rho = r_.states[k].rho.data() + size_t(col) * n, *da = da_[k].data() + size_t(col) * 2 * n;
      for (int l = 0; l < n; ++l)
        for (int o = 0; o < n; ++o) {
          const int row = c.independent[l], at = c.independent[o];
          entry(dq, row, at) += arm * rho[l] * da[o];
          entry(dv, row, at) += arm * rho[l] * da[n + o];
          entry(D, row, at) += arm * rho[l] * rho[o];
        }
    });
  }

  void springs_and_dampers(int k, double* dq, double* dv) {
    const Cluster& c = m_.clusters[k];
    const int n = c.n();
    for (int j : c.joints)
      for (int s = 0; s < m_.joints[j].nv; ++s) {
        const double stiffness = m_.joints[j].stiffness, damping = m_.joints[j].damping[s];
        if (stiffness == 0 && damping == 0) continue;
        const size_t row = size_t(m_.column_of[m_.joints[j].v] + s) * n;
        const double *rho = &r_.states[k].rho[row], *change = &dv_[k][row];
        for (int l = 0; l < n; ++l)
          for (int o = 0; o < n; ++o) {
            entry(dq, c.independent[l], c.independent[o]) += rho[l] * (stiffness * rho[o] + damping * change[o]);
            entry(dv, c.independent[l], c.independent[o]) += rho[l] * damping * rho[o];
          }
      }
  }

  // The entries between a cluster and every one between it and the world: a change (dV, dA′) of the carrier's motion
  // changes the cluster's τ_i by U_i·dA′ + H_i·dV, and its turn X by K_i·X.
  void pass_down(const Cluster& c, double* dq, double* dv, double* D) {
    const int n = c.n();
    for (int p = c.parent; p;) {
      for (int i = 0; i < n; ++i)
        for (Force* f : {&P_[i], &Pv_[i], &U_[i], &H_[i], &K_[i]}) *f = out_of_frame(r_.pose[p], *f);
      const Cluster& below = m_.clusters[m_.cluster_of[p]];
      for (int i = 0; i < n; ++i)
        for (int l = 0; l < below.n(); ++l) {
          const int at = r_.x_offset[p] + l, row = below.independent[l], col = c.independent[i];
          entry(dq, row, col) = dot(P_[i], r_.X[at]);
          entry(dv, row, col) = dot(Pv_[i], r_.X[at]);
          entry(D, row, col) = entry(D, col, row) = dot(U_[i], r_.X[at]);
          entry(dq, col, row) = dot(U_[i], dA_[at]) + dot(H_[i], dV_[at]) + dot(K_[i], r_.X[at]);
          entry(dv, col, row) = dot(U_[i], dA_by_v_[at]) + dot(H_[i], r_.X[at]);
        }
      p = below.parent;
    }
  }
};

}  // namespace ccpin
