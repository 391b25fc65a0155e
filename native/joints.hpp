// The joint kinds of the tree: pose, motion subspace, and moves along their configuration manifolds. Configurations are
// Pinocchio's: (cosine, sine) on a circle, a unit quaternion (x, y, z, w), position and quaternion for a floating joint.
#pragma once
#include "rotations.hpp"

#include <array>

namespace ccpin {

enum class Kind { revolute, prismatic, continuous, spherical, planar, floating };
constexpr const char* kKindNames[] = {"revolute", "prismatic", "continuous", "spherical", "planar", "floating"};
struct Sizes { int nq, nv; };
constexpr Sizes kSizes[] = {{1, 1}, {1, 1}, {2, 1}, {4, 3}, {4, 3}, {7, 6}};

// Whether a joint has a component: 0…2 a translation, 3…5 a rotation, about or along x, y, z.
inline bool has_component(Kind kind, int component) {
  switch (kind) {
    case Kind::spherical: return component >= 3 && component < 6;
    case Kind::planar: return component == 0 || component == 1 || component == 5;
    case Kind::floating: return component >= 0 && component < 6;
    default: return false;
  }
}


struct Joint {
  Kind kind;
  int parent;          // the joint that carries it, 0: the world
  int q, v, nq, nv;    // windows of q′ and q̇′
  Pose placement;      // in the parent joint's frame
  Vec3 axis;           // of revolute and prismatic joints; the others use z
  bool turned;         // whether the placement turns
  int along;           // the coordinate axis that `axis` lies along, −1: none
  double mass;
  Vec3 centre;         // of the body it carries
  Mat3 inertia;        // about that centre
  std::array<double, 6> armature, damping;
  double stiffness, rest;  // of its spring, k and θ₀; only where q′ holds one plain number
  double stribeck_speed;   // 0: its dry friction does not fall
};

// Where the circle or quaternion of a configuration begins and how long it is; (0, 0): none.
struct UnitWindow { int start, size; };
inline UnitWindow unit_window(Kind kind) {
  switch (kind) {
    case Kind::continuous: return {0, 2};
    case Kind::spherical: return {0, 4};
    case Kind::planar: return {2, 2};
    case Kind::floating: return {3, 4};
    default: return {0, 0};
  }
}

// R ← R times a turn about its own axis k with cosine c and sine s.
inline void turn_about(Mat3& R, int k, double c, double s) {
  const int i = k == 2 ? 0 : k + 1, j = k == 0 ? 2 : k - 1;
  const Vec3 u = R.col(i), v = R.col(j);
  R.col(i) = c * u + s * v, R.col(j) = c * v - s * u;
}

// The joint's frame in its cluster's frame, from its parent's (null: the cluster's), and the columns of its motion
// subspace there. Every column is fixed in the frame of the joint's own body.
inline void place(const Joint& j, const double* q, const Pose* parent, Pose& X, Motion* S) {
  if (!parent) X = j.placement;
  else {
    if (j.turned) X.R.noalias() = parent->R * j.placement.R;
    else X.R = parent->R;
    X.p = parent->p + parent->R * j.placement.p;
  }
  const auto turning = [&](const Vec3& a) -> Motion { return {X.p.cross(a), a}; };
  switch (j.kind) {
    case Kind::revolute: {
      const double c = std::cos(q[0]), s = std::sin(q[0]);
      if (j.along >= 0) {
        turn_about(X.R, j.along, c, j.axis[j.along] * s);
        S[0] = turning(X.R.col(j.along) * j.axis[j.along]);
      } else {
        X.R = (X.R * about(j.axis, c, s)).eval();
        S[0] = turning(X.R * j.axis);
      }
      return;
    }
    case Kind::prismatic: {
      const Vec3 a = X.R * j.axis;
      X.p += a * q[0];
      S[0] = {a, Vec3::Zero()};
      return;
    }
    case Kind::continuous:
      turn_about(X.R, 2, q[0], q[1]);
      S[0] = turning(X.R.col(2));
      return;
    case Kind::spherical:
      X.R = (X.R * quaternion(q).toRotationMatrix()).eval();
      for (int k = 0; k < 3; ++k) S[k] = turning(X.R.col(k));
      return;
    case Kind::planar:
      X.p += X.R.col(0) * q[0] + X.R.col(1) * q[1];
      turn_about(X.R, 2, q[2], q[3]);
      for (int k = 0; k < 2; ++k) S[k] = {X.R.col(k), Vec3::Zero()};
      S[2] = turning(X.R.col(2));
      return;
    case Kind::floating:
      X.p += X.R * Vec3(q[0], q[1], q[2]);
      X.R = (X.R * quaternion(q + 3).toRotationMatrix()).eval();
      for (int k = 0; k < 3; ++k) S[k] = {X.R.col(k), Vec3::Zero()}, S[3 + k] = turning(X.R.col(k));
  }
}

inline void turn_circle(double* u, double angle) {
  const double c = std::cos(angle), s = std::sin(angle), a = u[0] * c - u[1] * s, b = u[1] * c + u[0] * s;
  const double k = 1 / std::hypot(a, b);
  u[0] = a * k, u[1] = b * k;
}
inline void turn_quaternion(double* u, const Vec3& r) {
  const Eigen::Quaterniond n = (quaternion(u) * exp_rotation(r)).normalized();
  u[0] = n.x(), u[1] = n.y(), u[2] = n.z(), u[3] = n.w();
}
inline double angle_between(const double* a, const double* b) {
  return std::atan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1]);
}

// q ⊕ v, in place.
inline void retract(Kind kind, double* q, const double* v) {
  switch (kind) {
    case Kind::revolute: case Kind::prismatic: q[0] += v[0]; return;
    case Kind::continuous: turn_circle(q, v[0]); return;
    case Kind::spherical: turn_quaternion(q, Vec3(v[0], v[1], v[2])); return;
    case Kind::planar: {
      const double a = v[2];
      const bool small = std::abs(a) < 1e-4;
      const double s = small ? 1 - a * a / 6 : std::sin(a) / a, k = small ? a / 2 - a * a * a / 24 : (1 - std::cos(a)) / a;
      const double x = s * v[0] - k * v[1], y = k * v[0] + s * v[1];
      q[0] += q[2] * x - q[3] * y, q[1] += q[3] * x + q[2] * y;
      turn_circle(q + 2, a);
      return;
    }
    case Kind::floating: {
      const Vec3 r(v[3], v[4], v[5]), x(v[0], v[1], v[2]);
      const double t = r.norm();
      const double a = t < 1e-4 ? 0.5 - t * t / 24 : (1 - std::cos(t)) / (t * t);
      const double b = t < 1e-4 ? 1. / 6 - t * t / 120 : (t - std::sin(t)) / (t * t * t);
      const Vec3 moved = quaternion(q + 3) * Vec3(x + a * r.cross(x) + b * r.cross(r.cross(x)));
      q[0] += moved.x(), q[1] += moved.y(), q[2] += moved.z();
      turn_quaternion(q + 3, r);
    }
  }
}

// v with from ⊕ v = to.
inline void difference(Kind kind, const double* from, const double* to, double* v) {
  switch (kind) {
    case Kind::revolute: case Kind::prismatic: v[0] = to[0] - from[0]; return;
    case Kind::continuous: v[0] = angle_between(from, to); return;
    case Kind::spherical:
      Eigen::Map<Vec3>{v} = log_rotation(quaternion(from).conjugate() * quaternion(to));
      return;
    case Kind::planar: {
      const double t = angle_between(from + 2, to + 2), half = 0.5 * t;
      const double a = std::abs(half) > 1e-4 ? half / std::tan(half) : 1 - half * half / 3;
      const double dx = to[0] - from[0], dy = to[1] - from[1], c = from[2], s = from[3];
      const double x = c * dx + s * dy, y = -s * dx + c * dy;
      v[0] = a * x + half * y, v[1] = a * y - half * x, v[2] = t;
      return;
    }
    case Kind::floating: {
      const Eigen::Quaterniond turn = quaternion(from + 3).conjugate();
      const Vec3 r = log_rotation(turn * quaternion(to + 3));
      const Vec3 p = turn * Vec3(to[0] - from[0], to[1] - from[1], to[2] - from[2]);
      Eigen::Map<Vec3>{v} = p - 0.5 * r.cross(p) + LogCoefficients(r.squaredNorm()).c * r.cross(r.cross(p));
      Eigen::Map<Vec3>{v + 3} = r;
    }
  }
}

// dq/dt for a velocity v: v itself for plain coordinates, ½ q ⊗ ω for a quaternion.
inline void configuration_rate(Kind kind, const double* q, const double* v, double* rate) {
  const auto quaternion_rate = [](const double* u, const double* w, double* out) {
    const Eigen::Quaterniond r = quaternion(u) * Eigen::Quaterniond(0, w[0], w[1], w[2]);
    out[0] = 0.5 * r.x(), out[1] = 0.5 * r.y(), out[2] = 0.5 * r.z(), out[3] = 0.5 * r.w();
  };
  switch (kind) {
    case Kind::revolute: case Kind::prismatic: rate[0] = v[0]; return;
    case Kind::continuous: rate[0] = -q[1] * v[0], rate[1] = q[0] * v[0]; return;
    case Kind::spherical: quaternion_rate(q, v, rate); return;
    case Kind::planar:
      rate[0] = q[2] * v[0] - q[3] * v[1], rate[1] = q[3] * v[0] + q[2] * v[1];
      rate[2] = -q[3] * v[2], rate[3] = q[2] * v[2];
      return;
    case Kind::floating: {
      const Vec3 moved = quaternion(q + 3) * Vec3(v[0], v[1], v[2]);
      rate[0] = moved.x(), rate[1] = moved.y(), rate[2] = moved.z();
      quaternion_rate(q + 3, v + 3, rate + 3);
    }
  }
}

}  // namespace ccpin
