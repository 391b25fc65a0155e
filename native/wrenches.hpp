// Wrenches that act on links from outside, as ccpin.dynamics.wrenches has them: w in D′q̈′ + C′q̇′ + g′ = Sᵀu + Jᵀw + φ_q′ᵀλ.
//
// Force and moment keep their components in the world, the force acts at a point of a joint's body. Seen from a frame that
// turns by δ they change by f × δ and m × δ, with the arm from that frame's origin to the point held: what w asks of the
// joints changes by −w's own change, {δ × f, δ × m + arm × (δ × f)}, which has the form of a CoriolisMap.
#pragma once
#include "kinematics.hpp"

namespace ccpin {

struct Push {
  int joint;
  Vec3 force, moment;  // in world axes
  Vec3 point;          // in the axes of the joint's body
};
using Pushes = std::vector<Push>;

// A wrench in the frame of the body that carries its joint's cluster, and the arm from that frame's origin.
struct Carried { Vec3 force, moment, arm; };

inline Carried carried(const Kinematics& k, const Push& w) {
  const Mat3 turn = k.world(k.m.clusters[k.m.cluster_of[w.joint]].parent).R.transpose();
  const Pose& body = k.pose[w.joint];
  return {turn * w.force, turn * w.moment, body.p + body.R * w.point};
}
inline Force wrench(const Carried& w) { return {w.force, w.moment + w.arm.cross(w.force)}; }
inline CoriolisMap turning(const Carried& w) {
  CoriolisMap map;
  map.p = w.force;
  map.M = -skew(w.moment) - skew(w.arm) * skew(w.force);
  return map;
}

}  // namespace ccpin
