// Where a configuration q′ puts the joints: each in the frame of the body that carries its cluster.
#pragma once
#include "mechanism.hpp"

namespace ccpin {

// The two closure frames of a loop and the axes of its ancestor C, in the cluster's frame.
struct Ends { Pose A, B; Mat3 C; };

// A body's velocity V and acceleration A along a chain of joints (A with −g₀ where the chain begins with it).
struct Moving { Motion V, A; };

class Kinematics {
 public:
  const Mechanism& m;
  std::vector<double> q_free;  // q′
  std::vector<Pose> pose;      // by joint
  std::vector<Motion> S;       // motion subspace, by component of q̇′

  explicit Kinematics(const Mechanism& mechanism)
      : m(mechanism), q_free(mechanism.reference), pose(mechanism.joints.size()), S(mechanism.nv) {}

  void place_cluster(const Cluster& c) {
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      const Pose* parent = joint.parent == c.parent ? nullptr : &pose[joint.parent];
      place(joint, q_free.data() + joint.q, parent, pose[j], S.data() + joint.v);
    }
  }

  Ends ends(const Loop& loop) const {
    const auto on = [&](int joint, const Pose& frame) { return joint == loop.base ? frame : pose[joint] * frame; };
    return {on(loop.a, loop.frame_a), on(loop.b, loop.frame_b),
            loop.ancestor == loop.base ? Mat3::Identity() : pose[loop.ancestor].R};
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
    Motion s;
    for (int k = 0; k < joint.nv; ++k) s += S[joint.v + k] * x[m.column_of[joint.v] + k];
    return s;
  }

  // V and A − Σ S q̈′ of the last body of a path, the path's beginning at rest: A gains V × s at every joint.
  Moving travel(const std::vector<int>& path, const double* v) const {
    Moving end;
    for (int j : path) {
      const Motion s = own(j, v);
      end.A += cross(end.V, s);
      end.V += s;
    }
    return end;
  }

  void copy_cluster(const Cluster& c, const double* from, double* to) const {
    if (from == to) return;
    for (int j : c.joints) std::copy(from + m.joints[j].q, from + m.joints[j].q + m.joints[j].nq, to + m.joints[j].q);
  }
};

}  // namespace ccpin
