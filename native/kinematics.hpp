// Where a configuration q′ puts the joints: each in the frame of the body that carries its cluster.
#pragma once
#include "mechanism.hpp"

namespace ccpin {

// The two closure frames of a loop and the axes of its ancestor C, in the cluster's frame.
struct Ends { Pose A, B; Mat3 C = Mat3::Identity(); };

// A body's velocity V and acceleration A, seen from another one.
struct Moving { Motion V, A; };

class Kinematics {
 public:
  const Mechanism& m;
  std::vector<double> q_free;  // q′
  std::vector<Pose> pose;      // by joint
  std::vector<Motion> S;       // motion subspace, by component of q̇′
  std::vector<Moving> relative;  // by joint, from its cluster's frame: V and A − Σ S q̈′, after `travel`

  explicit Kinematics(const Mechanism& mechanism)
      : m(mechanism), q_free(mechanism.reference), pose(mechanism.joints.size()), S(mechanism.nv),
        relative(mechanism.joints.size()), ends_(mechanism.loops.size()) {}

  void place_cluster(const Cluster& c) {
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      const Pose* parent = joint.parent == c.parent ? nullptr : &pose[joint.parent];
      place(joint, q_free.data() + joint.q, parent, pose[j], S.data() + joint.v);
    }
  }

  // After `place_ends`; A and B are turned only where the loop's rows have vectors fixed in them.
  const Ends& ends(const Loop& loop) const { return ends_[&loop - m.loops.data()]; }
  const Ends& place_ends(const Loop& loop) {
    Ends& e = ends_[&loop - m.loops.data()];
    const auto place = [&](int joint, const Pose& frame, Pose& X) {
      if (joint == loop.base) {
        X = frame;
        return;
      }
      X.p = pose[joint].p + pose[joint].R * frame.p;
      if (loop.turns) X.R.noalias() = pose[joint].R * frame.R;
    };
    place(loop.a, loop.frame_a, e.A), place(loop.b, loop.frame_b, e.B);
    if (loop.ancestor != loop.base) e.C = pose[loop.ancestor].R;
    return e;
  }

  // The pose of a joint's body in the world.
  Pose world(int joint) const {
    Pose at;
    for (int j = joint; j; j = m.clusters[m.cluster_of[j]].parent) at = pose[j] * at;
    return at;
  }

  // s = Σ S x over a joint's own components, x given by local columns.
  Motion own(int j, const double* x) const {
    const Joint& joint = m.joints[j];
    const double* mine = x + m.column_of[joint.v];
    Motion s = S[joint.v] * mine[0];
    for (int k = 1; k < joint.nv; ++k) s += S[joint.v + k] * mine[k];
    return s;
  }

  // `relative` of a cluster's joints that move with v (local columns): A gains V × s at every joint.
  void travel(const Cluster& c, const double* v) {
    for (int j : c.joints) {
      const Motion s = own(j, v);
      const int parent = m.joints[j].parent;
      if (parent == c.parent) relative[j] = {s, Motion()};
      else relative[j] = {relative[parent].V + s, relative[parent].A + cross(relative[parent].V, s)};
    }
  }

  // The same of a joint on a loop, from the loop's ancestor C as if that were at rest: V − V_C, A − A_C − V_C × (V − V_C).
  Moving along(const Loop& loop, int joint) const {
    if (joint == loop.base) return {};
    if (loop.ancestor == loop.base) return relative[joint];
    const Moving &C = relative[loop.ancestor], &E = relative[joint];
    const Motion V = E.V - C.V;
    return {V, E.A - C.A - cross(C.V, V)};
  }

  bool same_cluster(const Cluster& c, const double* x, const double* y) const {
    return std::all_of(c.joints.begin(), c.joints.end(), [&](int j) {
      return std::equal(x + m.joints[j].q, x + m.joints[j].q + m.joints[j].nq, y + m.joints[j].q);
    });
  }
  void copy_cluster(const Cluster& c, const double* from, double* to) const {
    if (from == to) return;
    for (int j : c.joints) std::copy(from + m.joints[j].q, from + m.joints[j].q + m.joints[j].nq, to + m.joints[j].q);
  }

 private:
  std::vector<Ends> ends_;     // by loop
};

}  // namespace ccpin
