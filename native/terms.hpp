// D (23) and C (24), dense, with ρ and ρ̇: composite inertias I and B of the clusters' subtrees (the composite rigid-body
// algorithm, Featherstone 2008, table 6.2, and its Coriolis counterpart, Echeandia and Wensing 2021), with clusters for
// joints. With dX = d/dt X and B x = `coriolis`, the entries of rows i and columns k within a cluster are
//
//   D = Σ X_iᵀ I X_k,      C = Σ X_iᵀ (I dX_k + B X_k),
//
// and what a column asks of the bodies is carried to every cluster between it and the world.
#pragma once
#include "reduced_model.hpp"

namespace ccpin {

class Terms {
 public:
  explicit Terms(ReducedModel& model)
      : r_(model), m_(model.m), dX_(model.X.size()), I_(m_.joints.size()), B_(m_.joints.size()) {
    size_t most = 0;
    for (const Cluster& c : m_.clusters) most = std::max<size_t>(most, c.n());
    F_.resize(most), G_.resize(most), H_.resize(most);
  }

  // D, C (n × n), ρ and ρ̇ (n′ × n) at velocity v, after `sigma` or `at`.
  void matrices(const double* v, double* D, double* C, double* rho, double* rho_dot) {
    const int n = m_.n;
    r_.spread(v);
    r_.move_bodies(true, nullptr);
    std::fill(D, D + size_t(n) * n, 0.), std::fill(C, C + size_t(n) * n, 0.);
    std::fill(rho, rho + size_t(m_.nv) * n, 0.), std::fill(rho_dot, rho_dot + size_t(m_.nv) * n, 0.);
    for (size_t k = 0; k < m_.clusters.size(); ++k) rates(int(k), D, C, rho, rho_dot);
    for (size_t j = 1; j < m_.joints.size(); ++j)
      if (m_.carries[j]) I_[j] = matrix(r_.body[j].Y), B_[j] = coriolis_matrix(r_.body[j]);
    for (int k = int(m_.clusters.size()) - 1; k >= 0; --k) composite(m_.clusters[k], D, C);
  }

 private:
  ReducedModel& r_;
  const Mechanism& m_;
  std::vector<Motion> dX_;
  std::vector<double> rho_dot_;
  std::vector<Force> F_, G_, H_;  // I X, I dX + B X and Bᵀ X of one cluster's columns, summed over its bodies
  std::vector<Mat6, Eigen::aligned_allocator<Mat6>> I_, B_;

  static Mat6 coriolis_matrix(const ReducedModel::Body& b) {
    return matrix_of([&](const Motion& x) { return coriolis(b.Y, b.V, x); });
  }
  double& entry(double* matrix, int row, int col) const { return matrix[size_t(row) * m_.n + col]; }

  // ρ, ρ̇ and dX of one cluster, and its rotors' share of D and C.
  void rates(int k, double* D, double* C, double* rho, double* rho_dot) {
    const Cluster& c = m_.clusters[k];
    ClusterState& s = r_.states[k];
    const int n = c.n();
    rho_dot_.resize(size_t(c.width()) * n);
    r_.rho_dot(c, s, &r_.v_free[r_.offset[k]], rho_dot_.data());
    for (int col = 0; col < c.width(); ++col)
      for (int i = 0; i < n; ++i) {
        entry(rho, c.columns[col], c.independent[i]) = s.rho[size_t(col) * n + i];
        entry(rho_dot, c.columns[col], c.independent[i]) = rho_dot_[size_t(col) * n + i];
      }
    for (int j : c.joints) {
      const Joint& joint = m_.joints[j];
      Motion* dX = &dX_[r_.x_offset[j]];
      for (int i = 0; i < n; ++i) dX[i] = joint.parent == c.parent ? Motion() : dX_[r_.x_offset[joint.parent] + i];
      for (int l = 0; l < joint.nv; ++l) {
        const Motion& column = r_.S[joint.v + l];
        const Motion change = cross(r_.body[j].V, column);
        const size_t row = size_t(m_.column_of[joint.v] + l) * n;
        for (int i = 0; i < n; ++i) dX[i] += change * s.rho[row + i] + column * rho_dot_[row + i];
      }
    }
    r_.for_armature(c, [&](int col, double arm) {
      const double *at = &s.rho[size_t(col) * n], *rate = &rho_dot_[size_t(col) * n];
      for (int i = 0; i < n; ++i)
        for (int l = 0; l < n; ++l) {
          entry(D, c.independent[i], c.independent[l]) += arm * at[i] * at[l];
          entry(C, c.independent[i], c.independent[l]) += arm * at[i] * rate[l];
        }
    });
  }

  // The entries of one cluster, its children's done, and what its columns ask of the clusters below.
  void composite(const Cluster& c, double* D, double* C) {
    const int n = c.n();
    Mat6 inertia = Mat6::Zero(), turning = Mat6::Zero();
    for (int i = 0; i < n; ++i) F_[i] = G_[i] = H_[i] = Force();
    for (int j : c.joints) {
      const Motion *X = &r_.X[r_.x_offset[j]], *dX = &dX_[r_.x_offset[j]];
      const ReducedModel::Body& b = r_.body[j];
      const bool heavy = m_.carries[j];
      Mat6 B;
      if (c.parent) {
        B = heavy ? B_[j] : coriolis_matrix(b);
        inertia += heavy ? I_[j] : matrix(b.Y), turning += B;
      }
      for (int i = 0; i < n; ++i) {
        const Force IX = heavy ? apply(I_[j], X[i]) : b.Y * X[i];
        const Force CX = heavy ? apply(I_[j], dX[i]) + apply(B_[j], X[i]) : b.Y * dX[i] + coriolis(b.Y, b.V, X[i]);
        for (int l = 0; l < n; ++l) {
          entry(D, c.independent[l], c.independent[i]) += dot(IX, X[l]);
          entry(C, c.independent[l], c.independent[i]) += dot(CX, X[l]);
        }
        if (c.parent) F_[i] += IX, G_[i] += CX, H_[i] += apply(Mat6(B.transpose()), X[i]);
      }
    }
    if (!c.parent) return;
    I_[c.parent] += out_of_frame(r_.pose[c.parent], inertia);
    B_[c.parent] += out_of_frame(r_.pose[c.parent], turning);
    for (int p = c.parent; p;) {
      for (int i = 0; i < n; ++i)
        for (Force* f : {&F_[i], &G_[i], &H_[i]}) *f = out_of_frame(r_.pose[p], *f);
      const Cluster& below = m_.clusters[m_.cluster_of[p]];
      couple(c, below, &r_.X[r_.x_offset[p]], &dX_[r_.x_offset[p]], D, C);
      p = below.parent;
    }
  }

  // The entries between a cluster's columns and those of one that carries it.
  void couple(const Cluster& c, const Cluster& below, const Motion* X, const Motion* dX, double* D, double* C) {
    for (int i = 0; i < c.n(); ++i)
      for (int l = 0; l < below.n(); ++l) {
        const int row = below.independent[l], col = c.independent[i];
        entry(D, row, col) = entry(D, col, row) = dot(F_[i], X[l]);
        entry(C, row, col) = dot(G_[i], X[l]);
        entry(C, col, row) = dot(F_[i], dX[l]) + dot(H_[i], X[l]);
      }
  }
};

}  // namespace ccpin
