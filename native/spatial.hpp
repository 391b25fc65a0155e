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
inline double dot(const Force& a, const Motion& b) { return (a.f.cwiseProduct(b.v) + a.t.cwiseProduct(b.w)).sum(); }

// a × b on twists, a ×* f on wrenches; (a ×* f)·b = −f·(a × b).
inline Motion cross(const Motion& a, const Motion& b) { return {a.w.cross(b.v) + a.v.cross(b.w), a.w.cross(b.w)}; }
inline Force cross(const Motion& a, const Force& b) { return {a.w.cross(b.f), a.w.cross(b.t) + a.v.cross(b.f)}; }

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
inline Mat6 out_of_frame(const Pose& X, const Mat6& M) {  // a symmetric map from twists to wrenches
  const Mat3 &R = X.R, p = skew(X.p);
  const Mat3 A = R * M.topLeftCorner<3, 3>() * R.transpose(), B = R * M.topRightCorner<3, 3>() * R.transpose();
  const Mat3 D = R * M.bottomRightCorner<3, 3>() * R.transpose(), mixed = B - A * p, turned = p * B;
  Mat6 T;
  T.topLeftCorner<3, 3>() = A, T.topRightCorner<3, 3>() = mixed, T.bottomLeftCorner<3, 3>() = mixed.transpose();
  T.bottomRightCorner<3, 3>() = D + turned + turned.transpose() - p * A * p;
  return T;
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

inline RigidInertia& operator+=(RigidInertia& a, const RigidInertia& b) {
  a.m += b.m, a.h += b.h, a.I += b.I;
  return a;
}
inline RigidInertia out_of_frame(const Pose& X, const RigidInertia& Y) {
  const Vec3 h = X.R * Y.h;
  const Mat3 px = skew(X.p), hx = skew(h);
  return {Y.m, h + Y.m * X.p, X.R * Y.I * X.R.transpose() - px * hx - hx * px - Y.m * px * px};
}

// B x = ½ (V ×* Y x − Y (V × x) + x ×* Y V): the body's share of C′ x, whose C is of Christoffel's kind, so that Ḋ − 2C
// is skew symmetric (Lemma III.1; Echeandia and Wensing, 2021). Written out, it depends on x's angular part alone: force
// x_w × p with p the linear momentum, and moment M x_w. Sums of bodies have the same form.
struct CoriolisMap {
  Vec3 p = Vec3::Zero();
  Mat3 M = Mat3::Zero();
  CoriolisMap() = default;
  CoriolisMap(const RigidInertia& Y, const Motion& V) : p(Y.m * V.v - Y.h.cross(V.w)) {
    const Mat3 vx = skew(V.v), wx = skew(V.w), hx = skew(Y.h), turned = vx * hx;
    const Mat3 wI = wx * Y.I;
    M = 0.5 * (wI + wI.transpose() - skew(Y.I * V.w + Y.h.cross(V.v)) - turned - turned.transpose());
  }
  CoriolisMap& operator+=(const CoriolisMap& o) {
    p += o.p, M += o.M;
    return *this;
  }
  Force operator*(const Motion& x) const { return {x.w.cross(p), M * x.w}; }
  Force transposed(const Motion& x) const { return {Vec3::Zero(), p.cross(x.v) + M.transpose() * x.w}; }
};
inline CoriolisMap out_of_frame(const Pose& X, const CoriolisMap& B) {
  CoriolisMap out;
  out.p = X.R * B.p;
  out.M = X.R * B.M * X.R.transpose() - skew(X.p) * skew(out.p);
  return out;
}

}  // namespace ccpin
