// What closures and joints carry, as ccpin.simulation.results.forces has it: Newton and Euler over each joint's subtree, whose
// closures are cut. Where several wrenches on a closure are possible it is the one of the λ of least norm.
#pragma once
#include "reduced_model.hpp"

namespace ccpin {

// After `inverse` at the true acceleration and `multipliers` λ. Wrenches are (force, moment) in world axes: each closure's on
// its end A about A's closure point, and each joint's on its child about its origin; poses are the joints' in the world.
inline void bearing_forces(const ReducedModel& r, const double* lambda, double* closures, double* joints, double* poses) {
  const Mechanism& m = r.m;
  std::vector<Pose> world(m.joints.size());
  const auto write = [](const Mat3& turn, const Force& wrench, const Vec3& about, double* out) {
    Eigen::Map<Vec3>{out} = turn * wrench.f;
    Eigen::Map<Vec3>{out + 3} = turn * (wrench.t - about.cross(wrench.f));
  };
  std::vector<Force> carried = r.subtree;
  for (size_t k = 0; k < m.clusters.size(); ++k) {
    const Cluster& c = m.clusters[k];
    const Mat3 turn = world[c.parent].R;
    int row = 0;
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      Force on_a;
      for (int s = 0; s < loop.size; ++s, ++row) on_a += r.states[k].rows[row].a * lambda[loop.row + s];
      for (int j : loop.path_a) carried[j] += on_a * -1;
      for (int j : loop.path_b) carried[j] += on_a;
      write(turn, on_a, r.ends(loop).A.p, closures + 6 * i);
    }
    for (int j : c.joints) {
      world[j] = world[c.parent] * r.pose[j];
      write(turn, carried[j], r.pose[j].p, joints + 6 * (j - 1));
    }
  }
  for (size_t j = 0; j < m.joints.size(); ++j) {
    Eigen::Map<Eigen::Matrix<double, 4, 4, Eigen::RowMajor>> out(poses + 16 * j);
    out.setIdentity();
    out.topLeftCorner<3, 3>() = world[j].R, out.topRightCorner<3, 1>() = world[j].p;
  }
}

}  // namespace ccpin
