// The rows of a closure: value, derivative and rate. Every row is a sum of weighted products w (x·y) of vectors fixed in
// the closure's frames A and B or in the ancestor C, or of the gap p_B − p_A (ccpin.description.closure_kinds). The
// derivative of a row is a wrench on each of its two ends, so that φ̇ = W_A · V_A + W_B · V_B with V the ends' twists from
// C, which is held still: x fixed in a body that turns by δ gives (δ × x)·y = δ·(x × y), and the gap pulls at its points.
#pragma once
#include "kinematics.hpp"

namespace ccpin {

struct Row { Force a, b; };

// A vector of a closure, and its rate while the ends turn with w_a and w_b and the gap opens.
inline Vec3 vector_at(const Vector& x, const Ends& ends, const Vec3& gap) {
  switch (x.frame) {
    case Frame::A: return ends.A.R * x.local;
    case Frame::B: return ends.B.R * x.local;
    case Frame::C: return ends.C * x.local;
    default: return gap;
  }
}
inline Vec3 vector_rate(const Vector& v, const Vec3& x, const Vec3& w_a, const Vec3& w_b, const Vec3& opening) {
  switch (v.frame) {
    case Frame::A: return w_a.cross(x);
    case Frame::B: return w_b.cross(x);
    case Frame::C: return Vec3::Zero();
    default: return opening;
  }
}

// What a row asks of its ends: W_A = (−gap, on_a − p_A × gap) and W_B = (gap, on_b + p_B × gap), summed over products
// w (x·y) for x moving; and the rates of these sums.
struct Pull {
  Vec3 gap = Vec3::Zero(), on_a = Vec3::Zero(), on_b = Vec3::Zero();
  void add(Frame frame, double w, const Vec3& x, const Vec3& y) {
    if (frame == Frame::gap) gap += w * y;
    if (frame == Frame::A) on_a += w * x.cross(y);
    if (frame == Frame::B) on_b += w * x.cross(y);
  }
  void add_rate(Frame frame, double w, const Vec3& x, const Vec3& dx, const Vec3& y, const Vec3& dy) {
    if (frame == Frame::gap) gap += w * dy;
    if (frame == Frame::A) on_a += w * (dx.cross(y) + x.cross(dy));
    if (frame == Frame::B) on_b += w * (dx.cross(y) + x.cross(dy));
  }
};

// φ and the wrenches of one loop's rows.
inline void loop_rows(const Loop& loop, const Ends& ends, Row* row, double* phi) {
  const Vec3 &p = ends.A.p, &q = ends.B.p, gap = q - p;
  for (const LoopRow& r : loop.rows) {
    if (r.form == Form::point) {
      const Vec3 e = ends.C * r.products[0].x.local;
      *phi++ = e.dot(gap);
      *row++ = {{-e, e.cross(p)}, {e, q.cross(e)}};
    } else if (r.form == Form::direction) {
      Vec3 turn = Vec3::Zero();
      double value = 0;
      for (const Product& t : r.products) {
        const Vec3 a = ends.A.R * t.x.local, b = ends.B.R * t.y.local;
        value += a.dot(b), turn += a.cross(b);
      }
      *phi++ = value;
      *row++ = {{Vec3::Zero(), turn}, {Vec3::Zero(), -turn}};
    } else {
      Pull pull;
      double value = 0;
      for (const Product& t : r.products) {
        const Vec3 x = vector_at(t.x, ends, gap), y = vector_at(t.y, ends, gap);
        value += t.weight * x.dot(y);
        pull.add(t.x.frame, t.weight, x, y), pull.add(t.y.frame, t.weight, y, x);
      }
      *phi++ = value;
      *row++ = {{-pull.gap, pull.on_a - p.cross(pull.gap)}, {pull.gap, pull.on_b + q.cross(pull.gap)}};
    }
  }
}

// The rates of the same wrenches while the ends move with V_A and V_B.
inline void loop_row_rates(const Loop& loop, const Ends& ends, const Motion& Va, const Motion& Vb, Row* rate) {
  const Vec3 &p = ends.A.p, &q = ends.B.p, gap = q - p;
  const Vec3 va = Va.v + Va.w.cross(p), vb = Vb.v + Vb.w.cross(q), opening = vb - va;
  for (const LoopRow& r : loop.rows) {
    if (r.form == Form::point) {
      const Vec3 e = ends.C * r.products[0].x.local;
      *rate++ = {{Vec3::Zero(), e.cross(va)}, {Vec3::Zero(), vb.cross(e)}};
    } else if (r.form == Form::direction) {
      Vec3 turn = Vec3::Zero();
      for (const Product& t : r.products) {
        const Vec3 a = ends.A.R * t.x.local, b = ends.B.R * t.y.local;
        turn += Va.w.cross(a).cross(b) + a.cross(Vb.w.cross(b));
      }
      *rate++ = {{Vec3::Zero(), turn}, {Vec3::Zero(), -turn}};
    } else {
      Pull still, change;
      for (const Product& t : r.products) {
        const Vec3 x = vector_at(t.x, ends, gap), dx = vector_rate(t.x, x, Va.w, Vb.w, opening);
        const Vec3 y = vector_at(t.y, ends, gap), dy = vector_rate(t.y, y, Va.w, Vb.w, opening);
        still.add(t.x.frame, t.weight, x, y), still.add(t.y.frame, t.weight, y, x);
        change.add_rate(t.x.frame, t.weight, x, dx, y, dy), change.add_rate(t.y.frame, t.weight, y, dy, x, dx);
      }
      *rate++ = {{-change.gap, change.on_a - va.cross(still.gap) - p.cross(change.gap)},
                 {change.gap, change.on_b + vb.cross(still.gap) + q.cross(change.gap)}};
    }
  }
}

// Whether the axes of a closure with direction rows point the right way.
inline bool is_aligned(const Loop& loop, const Ends& ends) {
  for (const Alignment& t : loop.alignment)
    if (!((ends.A.R * t.a).dot(ends.B.R * t.b) > 0)) return false;
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
