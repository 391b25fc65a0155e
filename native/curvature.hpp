// Bounds of |ψ″| and |ψ‴| of one cluster's rows in a ball of displacements; how, is in ccpin.kinematics.curvature.
#pragma once
#include "tangent.hpp"

#include <Eigen/Eigenvalues>

#include <array>

namespace ccpin {

// One step of a chain from a loop's ancestor to its end: components of q̇′ in a row; the turns of a joint are one, and
// slides. `turns`: how many there are down to here. `own`: no other loop has it.
struct ChainStep { int component, count; bool turn, own; int turns; };

// A product of a loop's row, by codes of Frame, with the weight it has once lengths are in units; `last` of its row.
struct Term { double weight; int left, right; bool last; };

// Bounds of |ψ″| and |ψ‴|; and of |ψ‴[u, u, ·]|, |ψ‴[u, u, u]| for a step u.
struct Bent { double second = 0, third = 0, along = 0, thrice = 0; };

// Squares of the bounds of |ψ‴| of each loop's rows, along steps of its own and along shared ones; and of all other rows.
struct Thirds { std::vector<std::array<double, 2>> loops; double others = 0; };

class Curvature : public Tangent {
 public:
  explicit Curvature(const Mechanism& mechanism) : Tangent(mechanism) {
    std::vector<int> used(m.joints.size(), 0);
    for (const Loop& loop : m.loops)
      for (const auto* path : {&loop.path_a, &loop.path_b})
        for (int j : *path) ++used[j];
    loops_.resize(m.loops.size());
    for (const Cluster& c : m.clusters) scales_.push_back(scale(c));
    for (size_t k = 0; k < m.clusters.size(); ++k)
      for (int i : m.clusters[k].loops) loops_[i] = prepared(m.loops[i], used, scales_[k].unit);
    q_free = m.reference;
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      residuals(m.clusters[k], states[k], nullptr);
      scales_[k].bending = bounds(m.clusters[k], 0).second;
    }
  }

 protected:
  // Metres, or radians, that count as 1: of a cluster, of its columns and of its rows; and where columns stand among the
  // dependent ones (−1: nowhere). `bending`: |ψ″| around the reference.
  struct Scale { double unit; std::vector<double> columns, rows; std::vector<int> place; bool bent; double bending; };
  std::vector<Scale> scales_;  // by cluster
  const Scale& scale_of(const Cluster& c) const { return scales_[&c - m.clusters.data()]; }

  Thirds thirds_;  // of the last `bounds`

  Bent bounds(const Cluster& c, double radius) {
    const Scale& scale = scale_of(c);
    thirds_.loops.clear(), thirds_.others = 0;
    double own[2] = {0, 0}, shared[2] = {0, 0};
    for (int i : c.loops) {
      double alone[2], together[2];
      loop_bounds(m.loops[i], loops_[i], scale.unit, radius, alone, together);
      for (int o = 0; o < 2; ++o) own[o] = std::max(own[o], alone[o]), shared[o] += together[o];
      thirds_.loops.push_back({alone[1], together[1]});
    }
    double squares[2] = {own[0] + shared[0], own[1] + shared[1]};
    const auto add = [&](double second, double third) {
      squares[0] += second * second, squares[1] += third * third, thirds_.others += third * third;
    };
    if (scale.bent) other_bounds(c, scale, radius, add);
    return {std::sqrt(squares[0]), std::sqrt(squares[1])};
  }
  // The same along a step u: what each loop has of it counts.
  void along(const Cluster& c, const Thirds& thirds, const double* u, Bent& b, double factor) const {
    const Scale& scale = scale_of(c);
    double own = 0, shared = 0, thrice = 0, whole = 0;
    for (int col = 0; col < c.width(); ++col) whole += std::pow(u[col] / scale.columns[col], 2);
    for (size_t k = 0; k < c.loops.size(); ++k) {
      const Loop& loop = m.loops[c.loops[k]];
      double square = 0;
      for (const auto* columns : {&loop.columns_a, &loop.columns_b})
        for (const Column& i : *columns) square += std::pow(u[i.local] / scale.columns[i.local], 2);
      own = std::max(own, thirds.loops[k][0] * square * square), shared += thirds.loops[k][1] * square * square;
      thrice += (thirds.loops[k][0] + thirds.loops[k][1]) * square * square * square;
    }
    const double others = thirds.others * whole * whole;
    b.along = factor * std::sqrt(own + shared + others);
    b.thrice = std::min(factor * std::sqrt(thrice + others * whole), b.along * std::sqrt(whole));
  }

 private:
  // Sizes of a vector (0) and of its derivatives (1…3), the last factor along the steps in question.
  using Jet = std::array<double, 4>;
  struct Jets { Jet own[4], shared[4], whole[4]; };  // along a loop's own steps, along shared ones, along all; by Frame
  struct Prepared { std::vector<ChainStep> chains[2]; std::vector<Term> terms; Jets jets; bool shares; };
  std::vector<Prepared> loops_;

  Scale scale(const Cluster& c) const {
    Scale s{0, {}, {}, std::vector<int>(c.width(), -1), !c.components.empty(), 0};
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      double sum = loop.frame_a.p.norm() + loop.frame_b.p.norm();
      for (const auto* path : {&loop.path_a, &loop.path_b})
        for (int j : *path) sum += m.joints[j].placement.p.norm();
      s.unit = std::max(s.unit, 0.5 * sum);
    }
    if (!(s.unit > 0)) s.unit = 1;
    for (int k : c.columns) {
      const Joint& joint = *std::find_if(m.joints.begin() + 1, m.joints.end(), [&](const Joint& j) { return k < j.v + j.nv; });
      s.columns.push_back(slides(joint, k - joint.v) ? s.unit : 1);
    }
    for (int i : c.loops)
      for (const LoopRow& row : m.loops[i].rows) s.rows.push_back(gaps(row) ? s.unit : 1);
    for (int i : c.couplings) {
      s.rows.push_back(1);
      for (const CouplingTerm& t : m.couplings[i].terms) s.bent |= t.coefficients.size() > 2;
    }
    for (int i : c.components) s.rows.push_back(m.coordinates[i].component < 3 ? s.unit : 1);
    for (int k = 0; k < c.unknowns(); ++k) s.place[c.dependent[k]] = k;
    return s;
  }
  static bool slides(const Joint& joint, int component) {
    switch (joint.kind) {
      case Kind::prismatic: return true;
      case Kind::planar: return component < 2;
      case Kind::floating: return component < 3;
      default: return false;
    }
  }
  static int gaps(const Product& p) { return (p.x.frame == Frame::gap) + (p.y.frame == Frame::gap); }
  static int gaps(const LoopRow& row) {
    int most = 0;
    for (const Product& p : row.products) most = std::max(most, gaps(p));
    return most;
  }

  Prepared prepared(const Loop& loop, const std::vector<int>& used, double unit) const {
    Prepared p{};
    double turned[2][2] = {};
    for (int side = 0; side < 2; ++side) {
      int turns = 0;
      for (int j : side ? loop.path_b : loop.path_a) {
        const Joint& joint = m.joints[j];
        int sliding = 0;
        while (sliding < joint.nv && slides(joint, sliding)) ++sliding;
        const bool own = used[j] == 1;
        if (sliding < joint.nv) {
          p.chains[side].push_back({joint.v + sliding, joint.nv - sliding, true, own, ++turns});
          turned[!own][side] += 1;
        }
        if (sliding) p.chains[side].push_back({joint.v, sliding, false, own, turns});
        p.shares |= !own;
      }
      const double n = turns, alone = turned[0][side], together = turned[1][side];
      const auto jet = [&](double some) -> Jet { return {1, std::sqrt(some), std::sqrt(some * n), std::sqrt(some) * n}; };
      p.jets.own[side] = jet(alone), p.jets.shared[side] = jet(together), p.jets.whole[side] = jet(n);
    }
    for (Jet* jets : {p.jets.own, p.jets.shared, p.jets.whole}) jets[int(Frame::C)] = {1, 0, 0, 0};
    Eigen::Matrix<double, 3, Eigen::Dynamic> along[3];  // rows e·gap, by the frame of e
    for (auto& e : along) e.resize(3, 0);
    for (const LoopRow& row : loop.rows) {
      const int most = gaps(row);
      if (row.products.size() == 1 && most == 1) {
        const Product& only = row.products[0];
        const Vector& fixed = only.x.frame == Frame::gap ? only.y : only.x;
        auto& e = along[int(fixed.frame)];
        e.conservativeResize(3, e.cols() + 1);
        e.col(e.cols() - 1) = only.weight * fixed.local;
        continue;
      }
      for (const Product& t : row.products)
        p.terms.push_back({std::abs(t.weight) * size(t.x) * size(t.y) * std::pow(unit, gaps(t) - std::min(most, 1)),
                           int(t.x.frame), int(t.y.frame), &t == &row.products.back()});
    }
    for (int frame = 0; frame < 3; ++frame)
      if (along[frame].cols())
        p.terms.push_back({std::sqrt(largest_eigenvalue(along[frame] * along[frame].transpose())), frame, int(Frame::gap), true});
    return p;
  }
  static double largest_eigenvalue(const Mat3& a) { return Eigen::SelfAdjointEigenSolver<Mat3>(a, Eigen::EigenvaluesOnly).eigenvalues()[2]; }
  static double size(const Vector& x) { return x.frame == Frame::gap ? 1 : x.local.norm(); }

  // Squares of the bounds of a loop's rows, along steps of its own and along shared ones.
  void loop_bounds(const Loop& loop, const Prepared& p, double unit, double radius, double* own, double* shared) const {
    const Ends at = ends(loop);
    double first[2] = {0, 0}, second[2] = {0, 0}, third[2] = {0, 0};
    for (int side = 0; side < 2; ++side) {
      const Vec3& point = side ? at.B.p : at.A.p;
      double below = 0, below_3 = 0, along[2][3] = {};
      for (auto step = p.chains[side].rbegin(); step != p.chains[side].rend(); ++step) {
        double square = 1, rows[3];
        const double turns = step->turns;
        if (step->turn) {
          double sum = 0;
          for (int k = step->component; k < step->component + step->count; ++k)
            sum += (S[k].v + S[k].w.cross(point)).squaredNorm();
          const double lever = std::sqrt(step->count == 3 ? 0.5 * sum : sum) / unit + radius * std::sqrt(below);
          square = lever * lever;
        }
        rows[0] = square;
        rows[1] = turns * square + (step->turn ? below : 0);
        rows[2] = turns * turns * square + (step->turn ? below_3 : 0);
        for (int o = 0; o < 3; ++o) along[!step->own][o] += rows[o];
        below += square, below_3 += (2 * turns - step->turn) * square;
      }
      for (int k = 0; k < 2; ++k) {
        first[k] += along[k][0];
        second[k] = std::max(second[k], along[k][1]), third[k] = std::max(third[k], along[k][2]);
      }
    }
    const double gap = (at.B.p - at.A.p).norm() / unit + radius * std::sqrt(first[0] + first[1]);
    Jets jets = p.jets;
    const int last = int(Frame::gap);
    jets.own[last] = {gap, std::sqrt(first[0]), std::sqrt(second[0]), std::sqrt(third[0])};
    jets.shared[last] = {gap, std::sqrt(first[1]), std::sqrt(second[1]), std::sqrt(third[1])};
    jets.whole[last] = {gap, std::sqrt(first[0] + first[1]), std::sqrt(second[0] + second[1]), std::sqrt(third[0] + third[1])};
    own[0] = own[1] = shared[0] = shared[1] = 0;
    product_rule(p, jets.own, jets.whole, own);
    if (p.shares) product_rule(p, jets.shared, jets.whole, shared);
  }
  static void product_rule(const Prepared& p, const Jet* jets, const Jet* whole, double* squares) {
    double second = 0, third = 0;
    for (const Term& t : p.terms) {
      const Jet &x = jets[t.left], &y = jets[t.right], &u = whole[t.left], &v = whole[t.right];
      second += t.weight * (x[2] * v[0] + x[1] * v[1] + u[1] * y[1] + u[0] * y[2]);
      third += t.weight * (x[3] * v[0] + 2 * x[2] * v[1] + u[2] * y[1] + x[1] * v[2] + 2 * u[1] * y[2] + u[0] * y[3]);
      if (t.last) squares[0] += second * second, squares[1] += third * third, second = third = 0;
    }
  }

  // Of couplings that are not linear, and of components of joints in α.
  template <class F> void other_bounds(const Cluster& c, const Scale& scale, double radius, F&& add) const {
    for (int i : c.couplings) {
      double second = 0, third = 0;
      for (const CouplingTerm& t : m.couplings[i].terms) {
        const double unit = scale.columns[m.column_of[t.v]];
        const double* x = q_free.data() + t.q;
        const double far = std::abs((t.wrapped ? std::atan2(x[1], x[0]) : x[0]) - t.reference) + unit * radius;
        second += largest_slope(t, far, 2) * unit * unit, third += largest_slope(t, far, 3) * unit * unit * unit;
      }
      add(second, third);
    }
    for (int i : c.components) {
      const Coordinate& k = m.coordinates[i];
      if (k.component < 3) add(1 + radius, 2 + radius);
      else if (k.kind != Kind::planar) add_logarithm(rotation_vector(k, q_free.data() + m.joints[k.joint].q).norm() + radius, add);
    }
  }
  static double largest_slope(const CouplingTerm& term, double far, int order) {
    double total = 0;
    for (int k = int(term.coefficients.size()) - 1; k >= order; --k) {
      double factor = std::abs(term.coefficients[k]);
      for (int d = 0; d < order; ++d) factor *= k - d;
      total = total * far + factor;
    }
    return total;
  }
  template <class F> static void add_logarithm(double angle, F&& add) {
    if (!(angle < M_PI)) return add(INFINITY, INFINITY);
    const double t = std::max(angle, 0.5), cot = 1 / std::tan(0.5 * t), csc = 1 / std::sin(0.5 * t);
    const double g = 2 + 0.5 * t - 0.5 * t * cot, g1 = 0.5 - 0.5 * cot + 0.25 * t * csc * csc;
    const double g2 = 0.5 * csc * csc - 0.25 * t * csc * csc * cot, second = g1 * g + 0.5 * g;
    add(second, g2 * g * g + g1 * second + g1 * g + g / 3);
  }
};

}  // namespace ccpin
