// α: q′ → q. A coordinate is a whole joint, or one component of a joint with several freedoms: a component of its
// position, or of the rotation vector log(R_refᵀ R) from the reference (a planar joint's angle, for its rz).
#pragma once
#include "mechanism.hpp"

#include <cstring>

namespace ccpin {

// A joint with several freedoms, seen as a free body: its rotation, and a velocity split into linear and angular parts.
struct Local {
  Mat3 R;
  int first;  // the first of the three angular velocity components, and what an angular entry of a planar joint is
  bool planar;
  Local(Kind kind, const double* x) : planar(kind == Kind::planar) {
    first = kind == Kind::floating ? 3 : planar ? 2 : 0;
    R = planar ? about_z(x[2], x[3]) : quaternion(x + (kind == Kind::floating ? 3 : 0)).toRotationMatrix();
  }
  Vec3 linear(const double* v) const { return planar ? Vec3(v[0], v[1], 0) : Vec3(v[0], v[1], v[2]); }
  Vec3 angular(const double* v) const { return planar ? Vec3(0, 0, v[2]) : Vec3(v[first], v[first + 1], v[first + 2]); }
};

inline Vec3 rotation_vector(const Coordinate& c, const double* x) {
  const int o = c.kind == Kind::floating ? 3 : 0;
  return log_rotation(quaternion(c.reference.data() + o).conjugate() * quaternion(x + o));
}

// The value of a component, x being the joint's configuration.
inline double component(const Coordinate& c, const double* x) {
  if (c.component < 3) return x[c.component];
  if (c.kind == Kind::planar) return std::atan2(x[3], x[2]);
  return rotation_vector(c, x)[c.component - 3];
}

// The row of α_q′ on the joint's own columns, and its rate along the joint's velocity v (null: at rest).
inline void component_row(const Coordinate& c, const double* x, const double* v, double* row, double* rate) {
  std::fill(row, row + 6, 0.), std::fill(rate, rate + 6, 0.);
  const Local local(c.kind, x);
  if (c.component < 3) {  // row of R, and of R [ω]×
    const Eigen::RowVector3d along = local.R.row(c.component);
    const Eigen::RowVector3d turning = v ? Eigen::RowVector3d(along * skew(local.angular(v))) : Eigen::RowVector3d::Zero();
    for (int k = 0; k < (local.planar ? 2 : 3); ++k) row[k] = along[k], rate[k] = turning[k];
    return;
  }
  if (local.planar) {
    row[2] = 1;
    return;
  }
  const Vec3 r = rotation_vector(c, x);
  const LogCoefficients a(r.squaredNorm());
  const Mat3 K = skew(r), K2 = K * K, J = Mat3::Identity() + 0.5 * K + a.c * K2;
  Eigen::Map<Eigen::RowVector3d>{row + local.first} = J.row(c.component - 3);
  if (!v) return;
  const Vec3 turn = J * local.angular(v);
  const Mat3 k = skew(turn), change = 0.5 * k + 2 * a.c_t * r.dot(turn) * K2 + a.c * (k * K + K * k);
  Eigen::Map<Eigen::RowVector3d>{rate + local.first} = change.row(c.component - 3);
}

// q ⊖ from over one coordinate: the tangent step that leads from a value to another.
inline void coordinate_difference(const Coordinate& c, const double* from, const double* to, double* step) {
  if (c.whole()) return difference(c.kind, from, to, step);
  step[0] = to[0] - from[0];
  if (c.turns()) step[0] = std::remainder(step[0], 2 * M_PI);
}
inline void coordinate_retract(const Coordinate& c, double* q, const double* step) {
  if (c.whole()) retract(c.kind, q, step);
  else q[0] += step[0];
}
inline void coordinate_rate(const Coordinate& c, const double* q, const double* v, double* rate) {
  if (c.whole()) configuration_rate(c.kind, q, v, rate);
  else rate[0] = v[0];
}

// q = α(q′), q̇ = α_q′ q̇′ and q̈ = α_q′ q̈′ + α̇_q′ q̇′ in a mechanism's coordinates, wherever q′, q̇′ and q̈′ come from.
struct FreeMotion { const double *q, *v, *a; };
inline void read_coordinates(const Mechanism& m, const FreeMotion& free, double* q, double* v, double* a) {
  double row[6], rate[6];
  for (const Coordinate& c : m.coordinates) {
    const Joint& joint = m.joints[c.joint];
    const double *x = free.q + joint.q, *w = free.v + joint.v, *b = free.a + joint.v;
    if (c.whole()) {
      std::copy(x, x + c.nq, q + c.q), std::copy(w, w + c.nv, v + c.v), std::copy(b, b + c.nv, a + c.v);
      continue;
    }
    component_row(c, x, w, row, rate);
    q[c.q] = component(c, x), v[c.v] = a[c.v] = 0;
    for (int k = 0; k < joint.nv; ++k) v[c.v] += row[k] * w[k], a[c.v] += row[k] * b[k] + rate[k] * w[k];
  }
}

// Brings the circles and quaternions of q to unit length; false where one is far from it.
inline bool normalize(const Mechanism& m, double* q) {
  for (const Coordinate& c : m.coordinates) {
    const UnitWindow unit = c.whole() ? unit_window(c.kind) : UnitWindow{0, 0};
    if (!unit.size) continue;
    Eigen::Map<Eigen::VectorXd> u(q + c.q + unit.start, unit.size);
    const double length = u.norm();
    if (!(std::abs(length - 1) <= 1e-6)) return false;
    u /= length;
  }
  return true;
}

}  // namespace ccpin
