// How the rates of ψ's rows change along a direction of (q′, q̇′): D φ̇ and D φ̈, exact, q̈′ held.
//
// Every row of φ is linear in a point or a product of two vectors, so the points and directions of the two ends are
// carried as jets: value, rate and second rate, each with its derivative. The ancestor C is at rest. As in
// ccpin.kinematics.acceleration_derivatives.
#pragma once
#include "constraints.hpp"

namespace ccpin {

// The motion of a body along a chain of joints, and its derivative in a direction: the twist X of the step, and dV, dA,
// which are derivatives of V and A seen from the body itself (δV = dV + X × V).
struct BodyJet {
  Motion V, A, X, dV, dA;

  // Over a joint with S fixed in its moving body: s = S q̇′, gain = S q̈′ (q̈′ held), step = S δq′, ds = S δq̇′.
  void advance(const Motion& s, const Motion& gain, const Motion& step, const Motion& ds) {
    dV += cross(V, step) + ds;
    const Motion inner = cross(A, step);
    V += s, X += step;
    A += cross(V, s) + gain;
    dA += inner + cross(dV, s) + cross(V, ds);
  }
};

// A vector x with its rate and second rate, and their derivatives in the direction.
struct Jet {
  Vec3 x, x_1, x_2, dx, dx_1, dx_2;
};
inline Jet operator-(const Jet& a, const Jet& b) {
  return {a.x - b.x, a.x_1 - b.x_1, a.x_2 - b.x_2, a.dx - b.dx, a.dx_1 - b.dx_1, a.dx_2 - b.dx_2};
}

// ẋ = linear v₀ + ω × x and what follows from it, for a point (linear 1) or a direction (0) fixed in a body.
inline Jet carried(const BodyJet& b, const Vec3& x, double linear) {
  const Motion dV = b.dV + cross(b.X, b.V), dA = b.dA + cross(b.X, b.A);
  Jet j;
  j.x = x;
  j.x_1 = linear * b.V.v + b.V.w.cross(x);
  j.x_2 = linear * b.A.v + b.A.w.cross(x) + b.V.w.cross(j.x_1);
  j.dx = linear * b.X.v + b.X.w.cross(x);
  j.dx_1 = linear * dV.v + dV.w.cross(x) + b.V.w.cross(j.dx);
  j.dx_2 = linear * dA.v + dA.w.cross(x) + b.A.w.cross(j.dx) + dV.w.cross(j.x_1) + b.V.w.cross(j.dx_1);
  return j;
}

// What a row's derivative in the direction is: of its rate, and of its second rate.
struct RowSlope { double rate, second; };

inline RowSlope product_slope(const Jet& a, const Jet& b) {  // of (a·b)˙ and (a·b)¨
  return {a.x_1.dot(b.dx) + a.dx_1.dot(b.x) + a.x.dot(b.dx_1) + a.dx.dot(b.x_1),
          a.x_2.dot(b.dx) + b.x_2.dot(a.dx) + 2 * (a.x_1.dot(b.dx_1) + b.x_1.dot(a.dx_1)) + a.x.dot(b.dx_2) +
              b.x.dot(a.dx_2)};
}

inline void loop_row_slopes(const Loop& loop, const Ends& ends, const BodyJet& on_a, const BodyJet& on_b, RowSlope* out) {
  const Jet gap = carried(on_b, ends.B.p, 1) - carried(on_a, ends.A.p, 1);
  const auto jet = [&](const Vector& v) -> Jet {
    if (v.frame == Frame::gap) return gap;
    if (v.frame == Frame::A) return carried(on_a, ends.A.R * v.local, 0);
    if (v.frame == Frame::B) return carried(on_b, ends.B.R * v.local, 0);
    const Vec3 zero = Vec3::Zero();
    return {ends.C * v.local, zero, zero, zero, zero, zero};
  };
  for (const LoopRow& row : loop.rows) {
    if (row.form == Form::point) {
      const Vec3 e = ends.C * row.products[0].x.local;
      *out++ = {e.dot(gap.dx_1), e.dot(gap.dx_2)};
      continue;
    }
    RowSlope sum{0, 0};
    for (const Product& t : row.products) {
      const RowSlope one = product_slope(jet(t.x), jet(t.y));
      sum.rate += t.weight * one.rate, sum.second += t.weight * one.second;
    }
    *out++ = sum;
  }
}

// The same of a component coordinate's α̇ and α̈, over its joint's own components: velocity v, acceleration a, direction
// (step, dv).
inline RowSlope component_slope(const Coordinate& k, const double* x, const double* v, const double* a,
                                const double* step, const double* dv) {
  if (k.turns()) return {0, 0};
  const Local local(k.kind, x);
  const Vec3 w = local.angular(v), dw = local.angular(dv), alpha = local.angular(a), turn = local.angular(step);
  if (k.component < 3) {  // R v, and R (v̇ + ω × v)
    const Vec3 u = local.linear(v), du = local.linear(dv), second = local.linear(a) + w.cross(u);
    const Eigen::RowVector3d along = local.R.row(k.component);
    return {along.dot(turn.cross(u) + du), along.dot(turn.cross(second) + dw.cross(u) + w.cross(du))};
  }
  // ṙ = J(r) ω with b = [r]ײ ω = r (r·ω) − t ω, t = |r|²; r̈ likewise, and the derivatives of both.
  const Vec3 r = rotation_vector(k, x);
  const LogCoefficients c(r.squaredNorm());
  const double t = r.squaredNorm();
  const auto J = [&](const Vec3& y) -> Vec3 { return y + 0.5 * r.cross(y) + c.c * (r * r.dot(y) - t * y); };
  const Vec3 b = r * r.dot(w) - t * w, r_1 = J(w), dr = J(turn);
  const double t_1 = 2 * r.dot(r_1), dt = 2 * r.dot(dr);
  const Vec3 b_1 = r_1 * r.dot(w) + r * r_1.dot(w) - t_1 * w;
  const Vec3 db = dr * r.dot(w) + r * (dr.dot(w) + r.dot(dw)) - dt * w - t * dw;
  const Vec3 dr_1 = dw + 0.5 * (dr.cross(w) + r.cross(dw)) + c.c_t * dt * b + c.c * db;
  const double dt_1 = 2 * (dr.dot(r_1) + r.dot(dr_1)), dc_1 = c.c_tt * dt * t_1 + c.c_t * dt_1;
  const Vec3 db_1 = dr_1 * r.dot(w) + r_1 * (dr.dot(w) + r.dot(dw)) - dt_1 * w - t_1 * dw + dr * r_1.dot(w) +
                    r * (dr_1.dot(w) + r_1.dot(dw));
  const Vec3 turning = 0.5 * (dr_1.cross(w) + r_1.cross(dw));
  Vec3 dr_2 = turning + dc_1 * b + c.c_t * t_1 * db + c.c_t * dt * b_1 + c.c * db_1;
  const Vec3 e = r * r.dot(alpha) - t * alpha;  // and of J(r) ω̇, ω̇ held
  dr_2 += 0.5 * dr.cross(alpha) + c.c_t * dt * e + c.c * (dr * r.dot(alpha) + r * dr.dot(alpha) - dt * alpha);
  return {dr_1[k.component - 3], dr_2[k.component - 3]};
}

}  // namespace ccpin
