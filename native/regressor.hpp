// Slotine and Li's regressor, Y_r π = D q̈_r + C(q̇) q̇_r + damping q̇_r + g + ρᵀf with f the joints' dry friction: linear in
// the constants π of ccpin.dynamics.parameters, body by body, then joint by joint. Where q̇_r = q̇ it is that of (22).
//
// A body brings its ten columns in its own frame, in which its constants are stated. With its twists V and V_r for q̇ and q̇_r,
// q̈′_r = ρ q̈_r + ρ̇ q̇_r, A_r = Σ S q̈′_r + (V × S) q̇′_r less gravity, and M V = K(V) π_b, it asks for the wrench
//
//   K(A_r − ½ V × V_r) + ½ V ×* K(V_r) + ½ V_r ×* K(V)
//
// (Echeandia and Wensing 2021), which every coordinate feels that moves it.
#pragma once
#include "reduced_model.hpp"

namespace ccpin {

constexpr int kBodyConstants = 10;
// Rotor, damper, dry friction; of joints that can have a spring that, and where q′ holds one plain number its offset; and
// where a Stribeck speed is stated by how much friction falls from rest on.
inline int joint_constants(const Joint& joint) {
  return (joint.nq == 1 ? 5 : joint.kind == Kind::spherical ? 4 : 3) + (joint.stribeck_speed > 0);
}
inline int constants(const Mechanism& m) {
  int count = 0;
  for (size_t j = 1; j < m.joints.size(); ++j) count += kBodyConstants + joint_constants(m.joints[j]);
  return count;
}

class Regressor {
 public:
  explicit Regressor(ReducedModel& model)
      : r_(model), m_(model.m), columns_(constants(m_)), V_r_(m_.joints.size()), A_r_(m_.joints.size()), a_r_(m_.nv) {}

  // Y (n × constants), after `sigma` or `at`.
  void matrix(const double* v, const double* a, const double* v_r, double* Y) {
    std::fill(Y, Y + size_t(m_.n) * columns_, 0.);
    r_.spread(v_r);
    v_r_ = r_.v_free;
    r_.spread(v);
    r_.move_bodies(true, nullptr);
    r_.twists();
    for (size_t k = 0; k < m_.clusters.size(); ++k) follow(int(k), a, v_r);
    int column = kBodyConstants * int(m_.joints.size() - 1);
    for (size_t j = 1; j < m_.joints.size(); ++j) {
      body(int(j), Y + kBodyConstants * (j - 1));
      joint(int(j), Y + column);
      column += joint_constants(m_.joints[j]);
    }
  }

 private:
  using Columns = Eigen::Matrix<double, 6, kBodyConstants>;
  ReducedModel& r_;
  const Mechanism& m_;
  const int columns_;
  std::vector<Motion> V_r_, A_r_;           // by joint, in its cluster's frame
  std::vector<double> v_r_, a_r_, rho_dot_;  // q̇′_r and q̈′_r, cluster by cluster

  // q̈′_r, V_r and A_r of one cluster, its carrier's known.
  void follow(int k, const double* a, const double* v_r) {
    const Cluster& c = m_.clusters[k];
    ClusterState& s = r_.states[k];
    const int n = c.n();
    const double* rates = v_r_.data() + r_.offset[k];
    double* accelerations = a_r_.data() + r_.offset[k];
    rho_dot_.resize(size_t(c.width()) * n);
    r_.rho_dot(c, s, r_.v_free.data() + r_.offset[k], rho_dot_.data());
    for (int col = 0; col < c.width(); ++col) {
      accelerations[col] = 0;
      for (int i = 0, at = col * n; i < n; ++i, ++at)
        accelerations[col] += s.rho[at] * a[c.independent[i]] + rho_dot_[at] * v_r[c.independent[i]];
    }
    const Motion V0 = c.parent ? in_frame(r_.pose[c.parent], V_r_[c.parent]) : Motion();
    const Motion A0 = c.parent ? in_frame(r_.pose[c.parent], A_r_[c.parent]) : Motion{-m_.gravity, Vec3::Zero()};
    for (int j : c.joints) {
      const int parent = m_.joints[j].parent;
      const bool first = parent == c.parent;
      const Motion gained = r_.own(j, rates);
      V_r_[j] = (first ? V0 : V_r_[parent]) + gained;
      A_r_[j] = (first ? A0 : A_r_[parent]) + r_.own(j, accelerations) + cross(r_.body[j].V, gained);
    }
  }

  // The columns of a body, from its first on.
  void body(int j, double* Y) const {
    Pose seen = r_.pose[j];
    const Motion V = in_frame(seen, r_.body[j].V), V_r = in_frame(seen, V_r_[j]), A_r = in_frame(seen, A_r_[j]);
    const Columns turned = crossed(V, momentum(V_r)) + crossed(V_r, momentum(V));
    const Columns wrench = momentum(A_r - cross(V, V_r) * 0.5) + 0.5 * turned;
    for (int p = j;;) {
      const Cluster& c = m_.clusters[m_.cluster_of[p]];
      for (int i = 0; i < c.n(); ++i) {
        const Vec6 twist = vector(in_frame(seen, r_.X[r_.x_offset[p] + i]));
        Eigen::Map<Eigen::Matrix<double, 1, kBodyConstants>>(Y + size_t(c.independent[i]) * columns_).noalias() =
            twist.transpose() * wrench;
      }
      if (!(p = c.parent)) return;
      seen = r_.pose[p] * seen;
    }
  }

  // The columns of a joint's own constants, from their first on.
  void joint(int j, double* Y) const {
    const Joint& joint = m_.joints[j];
    const int k = m_.cluster_of[j], count = joint_constants(joint);
    const Cluster& c = m_.clusters[k];
    const double* q = r_.q_free.data() + joint.q;
    const Vec3 stretch = joint.kind == Kind::spherical ? log_rotation(quaternion(q)) : Vec3(q[0], 0, 0);  // of a spring, from zero
    for (int s = 0; s < joint.nv; ++s) {
      const int col = m_.column_of[joint.v] + s, at = r_.offset[k] + col;
      const double rate = r_.v_free[at], way = double(rate > 0) - double(rate < 0);
      double each[] = {a_r_[at], v_r_[at], way, s < 3 ? stretch[s] : 0., -1., 0.};
      if (joint.stribeck_speed > 0) each[count - 1] = way * std::exp(-std::pow(rate / joint.stribeck_speed, 2));
      for (int i = 0; i < c.n(); ++i)
        for (int t = 0; t < count; ++t)
          Y[size_t(c.independent[i]) * columns_ + t] += r_.states[k].rho[size_t(col) * c.n() + i] * each[t];
    }
  }

  // K(V): mass, mass times centre, then Ixx, Ixy, Iyy, Ixz, Iyz, Izz about the origin.
  static Columns momentum(const Motion& V) {
    const Vec3 &v = V.v, &w = V.w;
    Columns K = Columns::Zero();
    K.col(0).head<3>() = v;
    K.block<3, 3>(0, 1) = skew(w), K.block<3, 3>(3, 1) = -skew(v);
    K.row(3).tail<6>() << w.x(), w.y(), 0, w.z(), 0, 0;
    K.row(4).tail<6>() << 0, w.x(), w.y(), 0, w.z(), 0;
    K.row(5).tail<6>() << 0, 0, 0, w.x(), w.y(), w.z();
    return K;
  }
  static Columns crossed(const Motion& V, const Columns& wrenches) {
    const Mat3 w = skew(V.w);
    Columns out;
    out.topRows<3>().noalias() = w * wrenches.topRows<3>();
    out.bottomRows<3>().noalias() = w * wrenches.bottomRows<3>();
    out.bottomRows<3>().noalias() += skew(V.v) * wrenches.topRows<3>();
    return out;
  }
};

}  // namespace ccpin
