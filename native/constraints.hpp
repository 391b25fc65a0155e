// ψ = [φ; α] (9) on one cluster: its residual, its Jacobian and the rate of it, on local columns.
//
// Rows: of the cluster's loops, of its couplings, of its component coordinates. Whole joints among the coordinates need
// no row: their columns are known (`direct`), and only the `dependent` columns of J are solved for.
#pragma once
#include "coordinates.hpp"
#include "rows.hpp"

namespace ccpin {

// What one cluster holds at a configuration.
struct ClusterState {
  std::vector<Row> rows, row_rates;    // of the loops; the rates after `Parametrization::bias`
  std::vector<double> J;               // rows × width, columns in their places
  std::vector<double> A, diagonal;     // memory of the factor
  std::vector<int> pivot;
  std::vector<double> residual, gap;   // −φ and component gaps; gaps of the whole joints
  std::vector<double> right, step;     // right sides; a Newton step
  std::vector<double> rho, bias;       // ρ (width × n) and ρ̇ q̇ (width)
  std::vector<double> probe;           // ψ_q′⁻¹ B (unknowns × 2) for a B of no structure
  Factor factor;

  explicit ClusterState(const Cluster& c)
      : rows(c.loop_rows), row_rates(c.loop_rows), J(size_t(c.rows()) * c.width()), A(size_t(c.rows()) * c.unknowns()),
        diagonal(c.unknowns()), pivot(c.unknowns()), residual(c.rows()), gap(c.direct.size()),
        right(std::max(c.n(), c.rows() * std::max({4, c.n() + 2, 2 * c.n()}))), step(c.width()), rho(size_t(c.width()) * c.n()),
        bias(c.width()), probe(2 * c.unknowns()) {
    for (size_t k = 0; k < c.direct.size(); ++k) rho[size_t(c.direct[k]) * c.n() + k] = 1;
  }
  ClusterState(ClusterState&&) = default;
  void bind(const Cluster& c) { factor = {&c.pattern, A.data(), pivot.data(), diagonal.data(), c.rows(), c.unknowns()}; }
};

class Constraints : public Kinematics {
 public:
  std::vector<ClusterState> states;  // by cluster

  explicit Constraints(const Mechanism& mechanism) : Kinematics(mechanism) {
    states.reserve(m.clusters.size());
    for (const Cluster& c : m.clusters) states.emplace_back(c).bind(c);
  }

  // φ (m) and φ_q′ (m × n′, row-major) at any configuration.
  void value(const double* q, double* phi, double* jacobian) {
    closed_ = false;
    std::copy(q, q + m.nq, q_free.begin());
    std::fill(jacobian, jacobian + size_t(m.m) * m.nv, 0.);
    for_phi_rows([&](const Cluster& c, const ClusterState& s, int local, int global) {
      phi[global] = -s.residual[local];
      for (int col = 0; col < c.width(); ++col)
        jacobian[size_t(global) * m.nv + c.columns[col]] = s.J[size_t(local) * c.width() + c.place[col]];
    });
  }

  // Whether every closure with direction rows is closed the right way round.
  bool aligned() const {
    for (const Loop& loop : m.loops)
      if (!is_aligned(loop, ends(loop))) return false;
    return true;
  }

 protected:
  bool closed_ = false;  // whether all here, ρ included, is that of a closed q_free

  // Joints, −φ and the gaps to q (null: none wanted) of one cluster. Returns the largest residual.
  double residuals(const Cluster& c, ClusterState& s, const double* q) {
    place_cluster(c);
    int row = 0;
    for (int i : c.loops) {
      loop_rows(m.loops[i], place_ends(m.loops[i]), s.rows.data() + row, s.residual.data() + row);
      for (const int end = row + m.loops[i].size; row < end; ++row) s.residual[row] = -s.residual[row];
    }
    for (int i : c.couplings) coupling_jacobian(m.couplings[i], c, s, row++);
    for (int i : c.components) component_jacobian(m.coordinates[i], c, s, row++);
    return gaps(c, s, q);
  }
  // The gaps to q alone, where all else is as `residuals` has left it. Returns the same.
  double gaps(const Cluster& c, ClusterState& s, const double* q) const {
    int row = c.phi_rows();
    for (int i : c.components) s.residual[row++] = q ? component_gap(m.coordinates[i], q) : 0;
    double size = 0;
    for (double r : s.residual) size = std::max(size, std::abs(r));
    if (q) {
      whole_gaps(c, q, s.gap.data());
      for (double g : s.gap) size = std::max(size, std::abs(g));
    }
    return size;
  }

  // J of one cluster after `residuals`, and its factorised dependent columns.
  void factorize(const Cluster& c, ClusterState& s) const {
    int row = 0;
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      for (const int end = row + loop.size; row < end; ++row) {
        double* J = s.J.data() + size_t(row) * c.width();
        for (const Column& k : loop.columns_a) J[k.place] = dot(s.rows[row].a, S[k.component]);
        for (const Column& k : loop.columns_b) J[k.place] = dot(s.rows[row].b, S[k.component]);
      }
    }
    const int n = c.unknowns();
    for (const Block& b : c.pattern.blocks)
      for (int r : b.rows) {
        const double* J = s.J.data() + size_t(r) * c.width();
        double* A = s.A.data() + size_t(r) * n;
        for (int k = b.first; k < b.end; ++k) A[k] = J[k];
        for (int k = c.pattern.shared; k < n && &b != &c.pattern.blocks.back(); ++k) A[k] = J[k];
      }
    s.factor.factorize();
  }

  double linearize(const Cluster& c, ClusterState& s, const double* q) {
    const double size = residuals(c, s, q);
    factorize(c, s);
    return size;
  }

  // The tangent steps of the whole joints, and of the components, that lead from α(q′) to q.
  void whole_gaps(const Cluster& c, const double* q, double* out) const {
    for (int i : c.whole) {
      const Coordinate& k = m.coordinates[i];
      difference(k.kind, q_free.data() + m.joints[k.joint].q, q + k.q, out);
      out += k.nv;
    }
  }
  double component_gap(const Coordinate& k, const double* q) const {
    const double here = component(k, q_free.data() + m.joints[k.joint].q);
    double gap;
    coordinate_difference(k, &here, q + k.q, &gap);
    return gap;
  }

  // Each row of φ in turn, with its local and its global index.
  template <class F> void for_phi_rows(F&& f) {
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      linearize(c, states[k], nullptr);
      int local = 0;
      for (int i : c.loops)
        for (int r = 0; r < m.loops[i].size; ++r) f(c, states[k], local++, m.loops[i].row + r);
      for (int i : c.couplings) f(c, states[k], local++, m.couplings[i].row);
    }
  }

 private:
  void coupling_jacobian(const Coupling& coupling, const Cluster& c, ClusterState& s, int row) const {
    double* J = s.J.data() + size_t(row) * c.width();
    double total = 0;
    for (const CouplingTerm& t : coupling.terms) J[c.place[m.column_of[t.v]]] = 0;
    for (const CouplingTerm& t : coupling.terms)
      total += slope(t, q_free.data(), 0), J[c.place[m.column_of[t.v]]] += slope(t, q_free.data(), 1);
    s.residual[row] = -(coupling.modulus > 0 ? std::remainder(total, coupling.modulus) : total);
  }

  void component_jacobian(const Coordinate& k, const Cluster& c, ClusterState& s, int row) const {
    const Joint& joint = m.joints[k.joint];
    double along[6], unused[6];
    component_row(k, q_free.data() + joint.q, nullptr, along, unused);
    double* J = s.J.data() + size_t(row) * c.width();
    for (int i = 0; i < joint.nv; ++i) J[c.place[m.column_of[joint.v] + i]] = along[i];
  }
};

}  // namespace ccpin
