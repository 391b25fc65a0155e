// Whether a configuration a is proved to be joined to a closed one b by the lift of a straight line: the theorem of
// ccpin.kinematics.continuation with the bounds of ccpin.kinematics.derivative_bounds, cluster by cluster.
//
// Asked near singular sets only, so memory is taken as it is needed, and boxes lie along the joints.
#pragma once
#include "tangent.hpp"

namespace ccpin {

constexpr double kProofRoundoff = 32 * 0x1p-53, kProofMargin = 1 + 1e-9, kProofInflation = 1.2, kProofLargest = 4;
constexpr int kProofTries = 8;
constexpr double kLogSecond = 3.1, kLogThird = 9.1;

class Continuation : public Tangent {
 public:
  using Tangent::Tangent;

 protected:
  using Table = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

  // After `finish` at b = q_free, `off` being what is left of ψ̄ there; from what is missing at a: residual and gap as
  // they are in a state, ψ(b) − ψ(a).
  bool proved(const Cluster& c, ClusterState& s, const double* a, const std::vector<double>& residual,
              const std::vector<double>& gap, double off) {
    const int rows = c.rows(), width = c.width();
    Majorant P;
    P.closed = m.tolerance + off;
    P.inverse = inverse(c, s);
    std::vector<double> way(width, 0.), apart(width, 0.);
    Eigen::VectorXd right(rows);
    for (int r = 0; r < rows; ++r) {
      right[r] = -residual[r];
      for (size_t k = 0; k < c.direct.size(); ++k) right[r] += s.J[size_t(r) * width + c.unknowns() + k] * gap[k];
    }
    const Eigen::VectorXd dependent = P.inverse * right;
    for (int k = 0; k < c.unknowns(); ++k) way[c.dependent[k]] = dependent[k];
    for (size_t k = 0; k < c.direct.size(); ++k) way[c.direct[k]] = -gap[k];
    for (double x : way)
      if (!(std::abs(x) <= kProofLargest)) return false;
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      difference(joint.kind, q_free.data() + joint.q, a + joint.q, apart.data() + m.column_of[joint.v]);
    }
    const Table D = bend(c, s, way.data());
    P.change = (P.inverse * D).cwiseAbs();
    P.way = Eigen::Map<Eigen::VectorXd>(way.data(), width);
    P.constant = 0.5 * (P.inverse * (D * P.way)).cwiseAbs();
    P.inverse = P.inverse.cwiseAbs().eval();
    P.rounding = D.cwiseAbs();
    for (int r = 0; r < rows; ++r)
      for (int k = 0; k < width; ++k) P.rounding(r, k) += std::abs(s.J[size_t(r) * width + c.place[k]]);
    P.rounding *= kProofRoundoff * width;
    const Eigen::VectorXd off_line = (Eigen::Map<Eigen::VectorXd>(apart.data(), width) - P.way).cwiseAbs();
    P.way = P.way.cwiseAbs().eval();
    measure(c, P);
    return holds(c, s, P, off_line);
  }

 private:
  // P and what it is made of: |A| (unknowns × rows), |M| (unknowns × width), and the distances at b.
  struct Majorant {
    Table inverse, change, rounding;
    Eigen::VectorXd way, constant;
    double closed = 0;
    std::vector<double> arms, gaps;  // of each joint on each loop's paths, A first; of each loop
  };

  static Table inverse(const Cluster& c, const ClusterState& s) {
    const int rows = c.rows();
    Table unit = Table::Identity(rows, rows), found(c.unknowns(), rows);
    if (rows) s.factor.solve(unit.data(), rows);
    for (int k = 0; k < c.unknowns(); ++k) found.row(k) = unit.row(c.pattern.slots[k]);
    return found;
  }

  // D²Ψ(0)[step, ·] (rows × width). What φ_q′ gains along a step differs from it by ½ φ_q′ [step, ·]: right increments of
  // joints with several freedoms do not commute.
  Table bend(const Cluster& c, ClusterState& s, const double* step) {
    Table D = Table::Zero(c.rows(), c.width());
    bias(c, s, step);
    jacobian_rate(c, s, step, [&](int r, int k, double rate) { D(r, k) += rate; });
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      if (joint.nv < 3) continue;
      const int first = m.column_of[joint.v];
      const Motion own = twist(joint, step + first);
      for (int k = 0; k < joint.nv; ++k) {
        double unit[6] = {0}, bracket[6];
        unit[k] = 1;
        entries(joint, cross(own, twist(joint, unit)), bracket);
        for (int r = 0; r < c.rows(); ++r)
          for (int i = 0; i < joint.nv; ++i)
            D(r, first + k) -= 0.5 * s.J[size_t(r) * c.width() + c.place[first + i]] * bracket[i];
      }
    }
    return D;
  }
  // A joint's velocity components as a twist in its own axes, and back.
  static Motion twist(const Joint& joint, const double* v) {
    if (joint.kind == Kind::planar) return {Vec3(v[0], v[1], 0), Vec3(0, 0, v[2])};
    if (joint.kind == Kind::spherical) return {Vec3::Zero(), Vec3(v[0], v[1], v[2])};
    return {Vec3(v[0], v[1], v[2]), Vec3(v[3], v[4], v[5])};
  }
  static void entries(const Joint& joint, const Motion& x, double* v) {
    if (joint.kind == Kind::planar) v[0] = x.v.x(), v[1] = x.v.y(), v[2] = x.w.z();
    else if (joint.kind == Kind::spherical) Eigen::Map<Vec3>{v} = x.w;
    else Eigen::Map<Vec3>{v} = x.v, Eigen::Map<Vec3>{v + 3} = x.w;
  }

  static bool slides(Kind kind, int k) {
    return kind == Kind::prismatic || (kind == Kind::planar && k < 2) || (kind == Kind::floating && k < 3);
  }
  // How far joint j turns and slides at most where its components move by at most `moves`.
  struct Reach { double turn = 0, slide = 0; };
  Reach reach(int j, const double* moves) const {
    const Joint& joint = m.joints[j];
    Reach r;
    double square = 0;
    for (int k = 0; k < joint.nv; ++k) {
      const double x = moves[m.column_of[joint.v] + k];
      if (slides(joint.kind, k)) r.slide += x;
      else r.turn += x, square += x * x;
    }
    if (joint.kind == Kind::spherical || joint.kind == Kind::floating) r.turn = std::sqrt(square);
    return r;
  }

  // A length and its derivatives, or bounds of both.
  struct Jet { double value = 0, first = 0, second = 0, third = 0; };

  void measure(const Cluster& c, Majorant& P) const {
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      const Ends& e = ends(loop);
      P.gaps.push_back((e.B.p - e.A.p).norm());
      for (int side = 0; side < 2; ++side)
        for (int j : side ? loop.path_b : loop.path_a) {
          const Joint& joint = m.joints[j];
          double square = 0;
          for (int k = 0; k < joint.nv; ++k)
            if (!slides(joint.kind, k))
              square += (S[joint.v + k].v + S[joint.v + k].w.cross(side ? e.B.p : e.A.p)).squaredNorm();
          const bool ball = joint.kind == Kind::spherical || joint.kind == Kind::floating;
          P.arms.push_back(std::sqrt(ball ? 0.5 * square : square));
        }
    }
  }
  // How an end's point moves (value: the turns along its path).
  Jet end_jet(const std::vector<int>& path, const double* arms, const double* moves) const {
    Jet y;
    for (int k = int(path.size()) - 1; k >= 0; --k) {
      const Reach r = reach(path[k], moves);
      const double w = r.turn, own = w * (arms[k] + y.first + r.slide) + r.slide;
      y.third += w * (3 * y.second + w * (3 * y.first + own));
      y.second += w * (2 * y.first + own);
      y.first += own, y.value += w;
    }
    return y;
  }

  // Bounds of |D²ψ[v, v]| and |D³ψ[v, v, v]| of a cluster's rows where |v| ≤ moves.
  void bounds(const Cluster& c, const Majorant& P, const double* moves, double* second, double* third) const {
    const double* arms = P.arms.data();
    const double* gap = P.gaps.data();
    for (int i : c.loops) {
      const Loop& loop = m.loops[i];
      const Jet a = end_jet(loop.path_a, arms, moves);
      arms += loop.path_a.size();
      const Jet b = end_jet(loop.path_b, arms, moves);
      arms += loop.path_b.size();
      const double opening = a.first + b.first;
      const Jet open{*gap++ + opening, opening, a.second + b.second, a.third + b.third};
      const auto jet = [&](const Vector& x) -> Jet {
        if (x.frame == Frame::gap) return open;
        const double length = x.local.norm(), w = x.frame == Frame::A ? a.value : x.frame == Frame::B ? b.value : 0;
        return {length, length * w, length * w * w, length * w * w * w};
      };
      for (const LoopRow& row : loop.rows) {
        *second = *third = 0;
        for (const Product& t : row.products) {
          const Jet x = jet(t.x), y = jet(t.y);
          const double w = std::abs(t.weight);
          *second += w * (x.second * y.value + 2 * x.first * y.first + x.value * y.second);
          *third += w * (x.third * y.value + 3 * (x.second * y.first + x.first * y.second) + x.value * y.third);
        }
        ++second, ++third;
      }
    }
    for (int i : c.couplings) {  // the second derivative at b itself, the third by Taylor's formula
      *second = *third = 0;
      for (const CouplingTerm& t : m.couplings[i].terms) {
        const double x = moves[m.column_of[t.v]];
        *second += std::abs(slope(t, q_free.data(), 2)) * x * x;
        double power = x * x * x;
        for (int k = 3; k < int(t.coefficients.size()); ++k, power *= x / (k - 2))
          *third += std::abs(slope(t, q_free.data(), k)) * power;
      }
      ++second, ++third;
    }
    for (int i : c.components) {
      const Coordinate& k = m.coordinates[i];
      const Reach r = reach(k.joint, moves);
      if (k.component < 3) {
        const double own = r.turn * r.slide + r.slide;
        *second = r.turn * own, *third = r.turn * r.turn * own;
      } else if (k.kind == Kind::planar) *second = *third = 0;
      else if (rotation_vector(k, q_free.data() + m.joints[k.joint].q).norm() + r.turn < M_PI)
        *second = kLogSecond * r.turn * r.turn, *third = kLogThird * r.turn * r.turn * r.turn;
      else *second = *third = INFINITY;
      ++second, ++third;
    }
  }

  // P(E), on local columns.
  Eigen::VectorXd image(const Cluster& c, const ClusterState& s, const Majorant& P, const Eigen::VectorXd& radius) const {
    const int rows = c.rows(), width = c.width(), n = c.n();
    const Eigen::VectorXd box = P.way + radius;
    Eigen::VectorXd second(rows), third(rows), unused(rows);
    bounds(c, P, radius.data(), second.data(), unused.data());
    bounds(c, P, box.data(), unused.data(), third.data());
    const Eigen::VectorXd rest = 0.5 * second + third / 6 + P.rounding * box + Eigen::VectorXd::Constant(rows, P.closed);
    Eigen::VectorXd out = Eigen::VectorXd::Constant(width, P.closed);
    for (int k : c.direct) out[k] += kProofRoundoff * width * box[k];
    const Eigen::VectorXd dependent = P.constant + P.change * radius + P.inverse * rest;
    for (int i = 0; i < c.unknowns(); ++i) {
      const int col = c.dependent[i];
      out[col] = dependent[i];
      for (size_t k = 0; k < c.direct.size(); ++k)
        out[col] += std::abs(s.rho[size_t(col) * n + k]) * out[c.direct[k]];
    }
    return kProofMargin * out;
  }
  // (i) and (ii) for some E that is nowhere less than `apart`.
  bool holds(const Cluster& c, const ClusterState& s, const Majorant& P, const Eigen::VectorXd& apart) const {
    Eigen::VectorXd radius = Eigen::VectorXd::Zero(c.width());
    radius = image(c, s, P, radius);
    if (!radius.allFinite()) return false;
    Eigen::MatrixXd linear = Eigen::MatrixXd::Identity(c.width(), c.width());
    for (int i = 0; i < c.unknowns(); ++i) linear.row(c.dependent[i]) -= P.change.row(i);
    radius = linear.partialPivLu().solve(radius).eval();
    if (!(radius.minCoeff() >= 0)) return false;
    radius = (kProofInflation * radius).cwiseMax(apart);
    for (int k = 0; k < kProofTries; ++k) {
      const Eigen::VectorXd here = image(c, s, P, radius);
      if (!(here.maxCoeff() <= kProofLargest) || !here.allFinite()) return false;  // P grows with E
      if ((here.array() <= radius.array()).all()) {
        const Eigen::VectorXd beyond = image(c, s, P, 1.25 * radius);
        return beyond.maxCoeff() <= kProofLargest && beyond.allFinite() &&
               ((beyond - here).array() < 0.25 / (kProofMargin * kProofMargin) * radius.array()).all();
      }
      radius = (kProofInflation * here).cwiseMax(radius);
    }
    return false;
  }
};

}  // namespace ccpin
