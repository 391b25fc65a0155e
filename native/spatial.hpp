// Rigid-body algebra (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 2): poses, twists, wrenches, inertias.
// Every twist and wrench of a computation is written about the origin, and in the axes, of one common frame.
#pragma once
#include <Eigen/Dense>

namespace ccpin {

using Vec3 = Eigen::Vector3d;
using Mat3 = Eigen::Matrix3d;
using Vec6 = Eigen::Matrix<double, 6, 1>;
using Mat6 = Eigen::Matrix<double, 6, 6>;

inline Mat3 skew(const Vec3& a) {
  Mat3 s;
  s << 0, -a.z(), a.y(), a.z(), 0, -a.x(), -a.y(), a.x(), 0;
  return s;
}

struct Pose {
  Mat3 R = Mat3::Identity();
  Vec3 p = Vec3::Zero();
};
inline Pose operator*(const Pose& a, const Pose& b) { return {a.R * b.R, a.p + a.R * b.p}; }

// A twist: velocity v of the body point at the frame's origin, and angular velocity w.
struct Motion {
  Vec3 v = Vec3::Zero(), w = Vec3::Zero();
  Motion& operator+=(const Motion& o) {
    v += o.v, w += o.w;
    return *this;
  }
};
inline Motion operator+(Motion a, const Motion& b) { return a += b; }
inline Motion operator-(const Motion& a, const Motion& b) { return {a.v - b.v, a.w - b.w}; }
inline Motion operator*(const Motion& a, double s) { return {a.v * s, a.w * s}; }

// A wrench: force f, and moment t about the frame's origin.
struct Force {
  Vec3 f = Vec3::Zero(), t = Vec3::Zero();
  Force& operator+=(const Force& o) {
    f += o.f, t += o.t;
    return *this;
  }
};
inline Force operator+(Force a, const Force& b) { return a += b; }
inline Force operator-(const Force& a, const Force& b) { return {a.f - b.f, a.t - b.t}; }
inline Force operator*(const Force& a, double s) { return {a.f * s, a.t * s}; }
inline double dot(const Force& a, const Motion& b) { return a.f.dot(b.v) + a.t.dot(b.w); }

// a × b on twists, a ×* f on wrenches; (a ×* f)·b = −f·(a × b).
inline Motion cross(const Motion& a, const Motion& b) { return {a.w.cross(b.v) + a.v.cross(b.w), a.w.cross(b.w)}; }
inline Force cross(const Motion& a, const Force& b) { return {a.w.cross(b.f), a.w.cross(b.t) + a.v.cross(b.f)}; }
inline Mat6 cross_matrix(const Motion& a) {
  Mat6 M;
  M << skew(a.w), skew(a.v), Mat3::Zero(), skew(a.w);
  return M;
}

inline Vec6 vector(const Motion& m) { return (Vec6() << m.v, m.w).finished(); }
inline Vec6 vector(const Force& f) { return (Vec6() << f.f, f.t).finished(); }
inline Force apply(const Mat6& M, const Motion& x) {
  const Vec6 f = M * vector(x);
  return {f.head<3>(), f.tail<3>()};
}

// A twist written outside a frame X, in X's origin and axes; and a wrench written in X, outside.
inline Motion in_frame(const Pose& X, const Motion& m) {
  return {X.R.transpose() * (m.v - X.p.cross(m.w)), X.R.transpose() * m.w};
}
inline Force out_of_frame(const Pose& X, const Force& f) {
  const Vec3 g = X.R * f.f;
  return {g, X.R * f.t + X.p.cross(g)};
}
inline Mat6 out_of_frame(const Pose& X, const Mat6& M) {  // a linear map from twists to wrenches
  Mat6 T;
  T << X.R, Mat3::Zero(), skew(X.p) * X.R, X.R;
  return T * M * T.transpose();
}

struct RigidInertia {
  double m = 0;
  Vec3 h = Vec3::Zero();  // mass times centre
  Mat3 I = Mat3::Zero();  // about the origin
};
inline Force operator*(const RigidInertia& Y, const Motion& a) {
  return {Y.m * a.v - Y.h.cross(a.w), Y.I * a.w + Y.h.cross(a.v)};
}
inline Mat6 matrix(const RigidInertia& Y) {
  Mat6 M;
  M << Y.m * Mat3::Identity(), -skew(Y.h), skew(Y.h), Y.I;
  return M;
}

// ½ (V ×* I x − I (V × x) + x ×* I V): the body's share of C′ x. Its C is of Christoffel's kind, so that Ḋ − 2C is
// skew symmetric (Lemma III.1; Echeandia and Wensing, 2021, eq. 24).
inline Force coriolis(const RigidInertia& Y, const Motion& V, const Motion& x) {
  return (cross(V, Y * x) - Y * cross(V, x) + cross(x, Y * V)) * 0.5;
}

// How the velocity-dependent force V ×* I V changes with V.
inline Force velocity_slope(const RigidInertia& Y, const Motion& V, const Motion& dV) {
  return cross(dV, Y * V) + cross(V, Y * dV);
}

template <class F> Mat6 matrix_of(F&& force_of) {  // the matrix of a linear map from twists to wrenches
  Mat6 M;
  for (int k = 0; k < 6; ++k) {
    Motion unit;
    (k < 3 ? unit.v : unit.w)[k % 3] = 1;
    M.col(k) = vector(force_of(unit));
  }
  return M;
}

}  // namespace ccpin
