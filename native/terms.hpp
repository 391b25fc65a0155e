// D (23) and C (24), dense, with ρ and ρ̇: composite inertias I and Coriolis maps B of the clusters' subtrees (the composite rigid-body
// algorithm, Featherstone 2008, table 6.2, and its Coriolis counterpart, Echeandia and Wensing 2021), with clusters for
// joints. With dX = d/dt X, the entries of rows i and columns k within a cluster are
//
//   D = Σ X_iᵀ I X_k,      C = Σ X_iᵀ (I dX_k + B X_k),
//
// and what a column asks of the bodies is carried to every cluster between it and the world, in the world's axes, so that
// from one cluster to the next only the point that moments are about changes.
#pragma once
#include "reduced_model.hpp"

namespace ccpin {

// A body and all clusters it carries, as if rigid: how the wrench on it follows its acceleration and velocity.
struct Composite {
  RigidInertia I;
  CoriolisMap B;
  Composite() = default;
  Composite(const RigidInertia& Y, const Motion& V) : I(Y), B(Y, V) {}
};

// Adds a cluster's bodies to the one that carries it.
inline void carry(const Cluster& c, const Pose& carrier, std::vector<Composite>& bodies) {
  Composite sum;
  for (int j : c.joints) sum.I += bodies[j].I, sum.B += bodies[j].B;
  bodies[c.parent].I += out_of_frame(carrier, sum.I), bodies[c.parent].B += out_of_frame(carrier, sum.B);
}

class Terms {
 public:
  explicit Terms(ReducedModel& model)
      : r_(model), m_(model.m), dX_(model.X.size()), W_(model.X.size()), G_(model.X.size()),
        bodies_(m_.joints.size()), carriers_(m_.joints.size()), X_world_(model.X.size()), dX_world_(model.X.size()) {
    size_t most = 0;
    for (const Cluster& c : m_.clusters) {
      most = std::max<size_t>(most, c.n());
      if (c.parent) carriers_[c.parent].carries = true;
    }
    F_.resize(most), E_.resize(most), H_.resize(most);
  }

  // D, C (n × n), ρ and ρ̇ (n′ × n) at velocity v, after `sigma` or `at`.
  void matrices(const double* v, double* D, double* C, double* rho, double* rho_dot) {
    const int n = m_.n;
    r_.spread(v);
    r_.move_bodies(true, nullptr);
    r_.twists();
    std::fill(D, D + size_t(n) * n, 0.), std::fill(C, C + size_t(n) * n, 0.);
    std::fill(rho, rho + size_t(m_.nv) * n, 0.), std::fill(rho_dot, rho_dot + size_t(m_.nv) * n, 0.);
    for (size_t k = 0; k < m_.clusters.size(); ++k) {
      rates(int(k), D, C, rho, rho_dot);
      turn_to_world(m_.clusters[k]);
    }
    for (size_t j = 1; j < m_.joints.size(); ++j) bodies_[j] = Composite(r_.body[j].Y, r_.body[j].V);
    for (int k = int(m_.clusters.size()) - 1; k >= 0; --k) composite(m_.clusters[k], D, C);
  }

 private:
  ReducedModel& r_;
  const Mechanism& m_;
  std::vector<Motion> dX_;
  std::vector<double> rho_dot_;
  std::vector<Force> W_, G_;      // I X and I dX + B X over a joint's subtree within the cluster, n a joint
  std::vector<Force> F_, E_, H_;  // both, and Bᵀ X, over a whole cluster
  std::vector<Composite> bodies_;
  // A body that carries clusters: its axes in the world's, and where it is from its own cluster's frame, in the world's axes.
  struct Carrier {
    bool carries = false;
    Mat3 R;
    Vec3 lever;
  };
  std::vector<Carrier> carriers_;
  std::vector<Motion> X_world_, dX_world_;  // X and dX of carriers in the world's axes
  double& entry(double* matrix, int row, int col) const { return matrix[size_t(row) * m_.n + col]; }

  // ρ, ρ̇ and dX of one cluster, and its rotors' share of D and C.
  void rates(int k, double* D, double* C, double* rho, double* rho_dot) {
    const Cluster& c = m_.clusters[k];
    ClusterState& s = r_.states[k];
    const int n = c.n();
    rho_dot_.resize(size_t(c.width()) * n);
    r_.rho_dot(c, s, r_.v_free.data() + r_.offset[k], rho_dot_.data());
    for (int col = 0; col < c.width(); ++col)
      for (int i = 0; i < n; ++i) {
        entry(rho, c.columns[col], c.independent[i]) = s.rho[size_t(col) * n + i];
        entry(rho_dot, c.columns[col], c.independent[i]) = rho_dot_[size_t(col) * n + i];
      }
    for (int j : c.joints) {
      const Joint& joint = m_.joints[j];
      Motion* dX = dX_.data() + r_.x_offset[j];
      for (int i = 0; i < n; ++i) dX[i] = joint.parent == c.parent ? Motion() : dX_[r_.x_offset[joint.parent] + i];
      for (int l = 0; l < joint.nv; ++l) {
        const Motion& column = r_.S[joint.v + l];
        const Motion change = cross(r_.body[j].V, column);
        const size_t row = size_t(m_.column_of[joint.v] + l) * n;
        for (int i = 0; i < n; ++i) dX[i] += change * s.rho[row + i] + column * rho_dot_[row + i];
      }
    }
    r_.for_armature(c, [&](int col, double arm) {
      const double *at = s.rho.data() + size_t(col) * n, *rate = rho_dot_.data() + size_t(col) * n;
      for (int i = 0; i < n; ++i)
        for (int l = 0; l < n; ++l) {
          if (i <= l) entry(D, c.independent[i], c.independent[l]) += arm * at[i] * at[l];
          entry(C, c.independent[i], c.independent[l]) += arm * at[i] * rate[l];
        }
    });
  }

  // The carriers of one cluster, those below it done.
  void turn_to_world(const Cluster& c) {
    for (int j : c.joints) {
      Carrier& carrier = carriers_[j];
      if (!carrier.carries) continue;
      const Pose& pose = r_.pose[j];
      const Mat3 R = c.parent ? carriers_[c.parent].R : Mat3(Mat3::Identity());
      carrier.R.noalias() = R * pose.R, carrier.lever.noalias() = R * pose.p;
      for (int at = r_.x_offset[j], end = at + c.n(); at < end; ++at) {
        X_world_[at] = {R * r_.X[at].v, R * r_.X[at].w};
        dX_world_[at] = {R * dX_[at].v, R * dX_[at].w};
      }
    }
  }

  // The entries of one cluster, its children's done, and what its columns ask of the clusters below.
  void composite(const Cluster& c, double* D, double* C) {
    const int n = c.n();
    for (int i = 0; i < n; ++i) F_[i] = E_[i] = H_[i] = Force();
    for (int j : c.joints) {
      const auto& [I, B] = bodies_[j];
      for (int at = r_.x_offset[j], i = 0; i < n; ++i, ++at) {
        W_[at] = I * r_.X[at], G_[at] = I * dX_[at] + B * r_.X[at];
        if (c.parent) H_[i] += B.transposed(r_.X[at]);
      }
    }
    for (auto j = c.joints.rbegin(); j != c.joints.rend(); ++j) {
      const Joint& joint = m_.joints[*j];
      const Force *W = W_.data() + r_.x_offset[*j], *G = G_.data() + r_.x_offset[*j];
      for (int s = 0; s < joint.nv; ++s) {
        const double* rho = r_.states[m_.cluster_of[*j]].rho.data() + size_t(m_.column_of[joint.v] + s) * n;
        for (int i = 0; i < n; ++i) {
          const double inertia = dot(W[i], r_.S[joint.v + s]), turning = dot(G[i], r_.S[joint.v + s]);
          for (int l = 0; l < n; ++l) entry(C, c.independent[l], c.independent[i]) += rho[l] * turning;
          for (int l = 0; l <= i; ++l) entry(D, c.independent[l], c.independent[i]) += rho[l] * inertia;
        }
      }
      const bool first = joint.parent == c.parent;
      Force *W_below = first ? F_.data() : W_.data() + r_.x_offset[joint.parent];
      Force *G_below = first ? E_.data() : G_.data() + r_.x_offset[joint.parent];
      for (int i = 0; i < n; ++i) W_below[i] += W[i], G_below[i] += G[i];
    }
    for (int i = 0; i < n; ++i)
      for (int l = 0; l < i; ++l) entry(D, c.independent[i], c.independent[l]) = entry(D, c.independent[l], c.independent[i]);
    if (!c.parent) return;
    carry(c, r_.pose[c.parent], bodies_);
    const Mat3& R = carriers_[c.parent].R;
    for (int i = 0; i < n; ++i)
      for (Force* f : {&F_[i], &E_[i], &H_[i]}) *f = {R * f->f, R * f->t};
    for (int p = c.parent; p;) {
      for (int i = 0; i < n; ++i)  // H has moments alone
        for (Force* f : {&F_[i], &E_[i]}) f->t += carriers_[p].lever.cross(f->f);
      const Cluster& below = m_.clusters[m_.cluster_of[p]];
      couple(c, below, X_world_.data() + r_.x_offset[p], dX_world_.data() + r_.x_offset[p], D, C);
      p = below.parent;
    }
  }

  // The entries between a cluster's columns and those of one that carries it.
  void couple(const Cluster& c, const Cluster& below, const Motion* X, const Motion* dX, double* D, double* C) {
    for (int i = 0; i < c.n(); ++i)
      for (int l = 0; l < below.n(); ++l) {
        const int row = below.independent[l], col = c.independent[i];
        entry(D, row, col) = entry(D, col, row) = dot(F_[i], X[l]);
        entry(C, row, col) = dot(E_[i], X[l]);
        entry(C, col, row) = dot(F_[i], dX[l]) + H_[i].t.dot(X[l].w);
      }
  }
};

}  // namespace ccpin
