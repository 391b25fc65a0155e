// The rows of a closure: value, derivative and rate. The derivative of a row is a wrench on each of its two ends, so
// that φ̇ = W_A · V_A + W_B · V_B with V the ends' twists from the ancestor C, which is held still.
//
//   point      e·(p_A − p_B), e fixed in C      direction  Σ w (a·b)
//   offset     a·(p_B − p_A)                     distance   (|p_B − p_A|² − L²)/2L
#pragma once
#include "kinematics.hpp"

namespace ccpin {

struct Row { Force a, b; };

// φ and the wrenches of one loop's rows.
inline void loop_rows(const Loop& loop, const Ends& ends, Row* row, double* phi) {
  const Pose &A = ends.A, &B = ends.B;
  const Vec3 gap = B.p - A.p;
  for (const Vec3& axis : loop.basis) {
    const Vec3 e = ends.C * axis;
    *phi++ = -e.dot(gap);
    *row++ = {{e, A.p.cross(e)}, {-e, -B.p.cross(e)}};
  }
  for (const auto& direction : loop.directions) {
    Vec3 n = Vec3::Zero();
    double value = 0;
    for (const Product& p : direction) {
      const Vec3 a = A.R * p.a, b = B.R * p.b;
      value += p.weight * a.dot(b);
      n += p.weight * a.cross(b);
    }
    *phi++ = value;
    *row++ = {{Vec3::Zero(), n}, {Vec3::Zero(), -n}};
  }
  for (const Vec3& offset : loop.offsets) {
    const Vec3 a = A.R * offset;
    const Force W{a, B.p.cross(a)};
    *phi++ = a.dot(gap);
    *row++ = {W * -1, W};
  }
  if (loop.length > 0) {
    const Vec3 d = gap / loop.length;
    const Force W{d, B.p.cross(d)};
    *phi++ = (gap.dot(gap) - loop.length * loop.length) / (2 * loop.length);
    *row++ = {W * -1, W};
  }
}

// The rates of the same wrenches while the ends move with V_A and V_B.
inline void loop_row_rates(const Loop& loop, const Ends& ends, const Motion& Va, const Motion& Vb, Row* rate) {
  const Pose &A = ends.A, &B = ends.B;
  const Vec3 va = Va.v + Va.w.cross(A.p), vb = Vb.v + Vb.w.cross(B.p);
  for (const Vec3& axis : loop.basis) {
    const Vec3 e = ends.C * axis;
    *rate++ = {{Vec3::Zero(), va.cross(e)}, {Vec3::Zero(), -vb.cross(e)}};
  }
  for (const auto& direction : loop.directions) {
    Vec3 n = Vec3::Zero();
    for (const Product& p : direction) {
      const Vec3 a = A.R * p.a, b = B.R * p.b;
      n += p.weight * (Va.w.cross(a).cross(b) + a.cross(Vb.w.cross(b)));
    }
    *rate++ = {{Vec3::Zero(), n}, {Vec3::Zero(), -n}};
  }
  for (const Vec3& offset : loop.offsets) {
    const Vec3 a = A.R * offset, da = Va.w.cross(a);
    const Force W{da, vb.cross(a) + B.p.cross(da)};
    *rate++ = {W * -1, W};
  }
  if (loop.length > 0) {
    const Vec3 d = (B.p - A.p) / loop.length, dd = (vb - va) / loop.length;
    const Force W{dd, vb.cross(d) + B.p.cross(dd)};
    *rate++ = {W * -1, W};
  }
}

// Whether the axes of a closure with direction rows point the right way.
inline bool is_aligned(const Loop& loop, const Ends& ends) {
  for (const Product& p : loop.alignment)
    if (!((ends.A.R * p.a).dot(ends.B.R * p.b) > 0)) return false;
  return true;
}

// The derivative of an order of a coupling's polynomial in one joint's displacement from its reference.
inline double slope(const CouplingTerm& term, const double* q_free, int order) {
  const double* x = q_free + term.q;
  const double displacement = (term.wrapped ? std::atan2(x[1], x[0]) : x[0]) - term.reference;
  double total = 0;
  for (int k = int(term.coefficients.size()) - 1; k >= order; --k) {
    double factor = term.coefficients[k];
    for (int d = 0; d < order; ++d) factor *= k - d;
    total = total * displacement + factor;
  }
  return total;
}

}  // namespace ccpin
