// Which Newton step stays on its branch: the theorem is in ccpin.kinematics.branches, the bounds of ψ″ and ψ‴ over a box
// in ccpin.kinematics.curvature. Here both are by cluster, on its local columns; those of whole independent joints move as
// told, so that boxes are about the dependent ones.
#pragma once
#include "tangent.hpp"

namespace ccpin {

// What proofs need of the configuration of a cluster that they start from.
struct ProofStart {
  std::vector<double> inverse, size;  // ψ_q′⁻¹ (its columns one after the other), and its absolute values
  std::vector<double> levers, gaps;   // distances of the loops' ends from the joints of their chains; their gaps
  std::vector<double> angles;         // of the couplings' terms, and of the components that turn
};

// One component of q̇′ on a chain from a loop's ancestor to its end; turns about one centre share a ball's number.
struct ChainStep { int component, column; bool turn; int ball; };

class Branches : public Tangent {
 public:
  explicit Branches(const Mechanism& mechanism) : Tangent(mechanism), first_size_{0} {
    for (const Loop& loop : m.loops) {
      chains_.push_back(chain(loop.path_a)), chains_.push_back(chain(loop.path_b));
      for (const LoopRow& row : loop.rows)
        for (const Product& p : row.products) sizes_.push_back(std::abs(p.weight) * length(p.x) * length(p.y));
      first_size_.push_back(int(sizes_.size()));
    }
    for (const Cluster& c : m.clusters) starts_.emplace_back(), prepare(c, starts_.back());
  }

 protected:
  std::vector<ProofStart> starts_;         // by cluster: where the Newton iteration at hand began
  std::vector<double> centre_, radius_;    // the box of the last proof, by local column
  double part_ = 0, likely_ = 0;           // what it proved

  // How much of the step s.step stays on its branch; the cluster is linearised where it begins. Uses s.right, s.bias.
  double prove(const Cluster& c, ClusterState& s, ProofStart& start) {
    look(c, s, start);
    const int width = c.width();
    u_.resize(width), radius_.resize(width), centre_.assign(width, 0.);
    rows_.assign(c.rows(), m.tolerance);
    spread(c, start, noise_);
    for (int k = 0; k < width; ++k) u_[k] = std::abs(s.step[k]) + noise_[k];
    part_ = 1, likely_ = 2;
    if (around(c, start, u_, radius_)) return part_;
    return along(c, s, start);
  }

  // The largest |Δq| (by component) of which all steps ρ Δq are proven, and the box for them.
  double free_way(const Cluster& c, ClusterState& s, ProofStart& start, std::vector<double>& radius) {
    look(c, s, start);
    const int n = c.n();
    u_.resize(c.width()), radius.resize(c.width());
    rows_.assign(c.rows(), m.tolerance);
    spread(c, start, noise_);
    double way = 0.1;
    for (int trial = 0; trial < 8; ++trial) {
      for (int col = 0; col < c.width(); ++col) {
        double sum = 0;
        for (int i = 0; i < n; ++i) sum += std::abs(s.rho[size_t(col) * n + i]);
        u_[col] = way * sum + noise_[col];
      }
      if (around(c, start, u_, radius)) return way;
      way *= 0.4;
    }
    return 0;
  }

  void look(const Cluster& c, ClusterState& s, ProofStart& start) {
    const int rows = c.rows(), unknowns = c.unknowns();
    square_.assign(size_t(rows) * rows, 0.);
    for (int k = 0; k < rows; ++k) square_[size_t(k) * rows + k] = 1;
    if (rows) s.factor.solve(square_.data(), rows);
    for (int k = 0; k < unknowns; ++k) {
      const double* y = square_.data() + size_t(c.pattern.slots[k]) * rows;
      for (int r = 0; r < rows; ++r) start.inverse[size_t(r) * unknowns + k] = y[r];
    }
    for (size_t k = 0; k < start.inverse.size(); ++k) start.size[k] = std::abs(start.inverse[k]);
    start.levers.clear(), start.gaps.clear(), start.angles.clear();
    for (int i : c.loops) {
      const Ends at = ends(m.loops[i]);
      start.gaps.push_back((at.B.p - at.A.p).norm());
      for (int side = 0; side < 2; ++side) {
        const std::vector<ChainStep>& steps = chains_[2 * i + side];
        const Vec3& p = side ? at.B.p : at.A.p;
        const auto square = [&](const ChainStep& k) { return (S[k.component].v + S[k.component].w.cross(p)).squaredNorm(); };
        for (const ChainStep& k : steps) {
          double sum = k.ball ? 0 : square(k);
          if (k.ball)
            for (const ChainStep& other : steps) sum += other.ball == k.ball ? 0.5 * square(other) : 0.;
          start.levers.push_back(std::sqrt(sum));
        }
      }
    }
    for (int i : c.couplings)
      for (const CouplingTerm& t : m.couplings[i].terms) {
        const double* x = q_free.data() + t.q;
        start.angles.push_back(std::abs((t.wrapped ? std::atan2(x[1], x[0]) : x[0]) - t.reference));
      }
    for (int i : c.components) {
      const Coordinate& k = m.coordinates[i];
      const bool ball = k.component >= 3 && k.kind != Kind::planar;
      start.angles.push_back(ball ? rotation_vector(k, q_free.data() + m.joints[k.joint].q).norm() : 0.);
    }
  }

 private:
  static constexpr double kBelowOne = 0.98, kLikely = 0.55;
  static constexpr int kRounds = 5, kTrials = 8;
  using Vector_ = std::vector<double>;
  std::vector<std::vector<ChainStep>> chains_;  // by loop: to A, to B
  std::vector<double> sizes_;     // by product of the loops' rows: its weight times the lengths of its fixed vectors
  std::vector<int> first_size_;   // by loop
  Vector_ u_, bent_, noise_, square_, turning_, bend_, sag_, box_, w_, image_, need_, step_;  // by local column, matrices
  Vector_ part_u_, part_bend_, part_sag_, distance_, rows_, unknown_, elimination_;

  // Bounds of a vector and of its derivatives along r and w.
  struct Jet { double size, r, w, rr, rw, rrw; };

  std::vector<ChainStep> chain(const std::vector<int>& path) const {
    std::vector<ChainStep> steps;
    for (int j : path) {
      const Joint& joint = m.joints[j];
      const int slides = joint.kind == Kind::prismatic ? 1 : joint.kind == Kind::planar ? 2 : joint.kind == Kind::floating ? 3 : 0;
      const int ball = joint.kind == Kind::spherical || joint.kind == Kind::floating ? j : 0;
      for (int k = slides; k < joint.nv; ++k) steps.push_back({joint.v + k, m.column_of[joint.v + k], true, ball});
      for (int k = 0; k < slides; ++k) steps.push_back({joint.v + k, m.column_of[joint.v + k], false, 0});
    }
    return steps;
  }
  static void prepare(const Cluster& c, ProofStart& start) {
    start.inverse.resize(size_t(c.unknowns()) * c.rows()), start.size = start.inverse;
  }

  // Adds f sup|ψ″[r, w]| + g sup|ψ‴[r, r, w]| over a box to `rows_`.
  void bounds(const Cluster& c, const ProofStart& start, const Vector_& box, const Vector_& r, const Vector_& w, double f,
              double g) {
    const double* lever = start.levers.data();
    int row = 0, gap = 0;
    for (int i : c.loops) {
      Jet vectors[4] = {{}, {}, {1, 0, 0, 0, 0, 0}, {start.gaps[gap++], 0, 0, 0, 0, 0}};
      for (int side = 0; side < 2; ++side) {
        const std::vector<ChainStep>& steps = chains_[2 * i + side];
        follow(steps, lever, box, r, w, vectors[side], vectors[3]);
        lever += steps.size();
      }
      const double* size = sizes_.data() + first_size_[i];
      for (const LoopRow& line : m.loops[i].rows) {
        double d = 0, t = 0;
        for (const Product& p : line.products) {
          const Jet &x = vectors[int(p.x.frame)], &y = vectors[int(p.y.frame)];
          d += *size * (x.rw * y.size + x.r * y.w + x.w * y.r + x.size * y.rw);
          t += *size++ * (x.rrw * y.size + 2 * (x.rw * y.r + x.r * y.rw) + x.rr * y.w + x.w * y.rr + x.size * y.rrw);
        }
        rows_[row++] += f * d + g * t;
      }
    }
    const double* angle = start.angles.data();
    for (int i : c.couplings) {
      double d = 0, t = 0;
      for (const CouplingTerm& term : m.couplings[i].terms) {
        const int k = m.column_of[term.v];
        const double far = *angle++ + box[k];
        d += slope_bound(term, far, 2) * r[k] * w[k], t += slope_bound(term, far, 3) * r[k] * r[k] * w[k];
      }
      rows_[row++] += f * d + g * t;
    }
    for (int i : c.components) {
      double d, t;
      component_bounds(m.coordinates[i], *angle++, box, r, w, d, t);
      rows_[row++] += f > 0 ? f * d : g * t;
    }
  }
  static double length(const Vector& x) { return x.frame == Frame::gap ? 1 : x.local.norm(); }

  void follow(const std::vector<ChainStep>& steps, const double* lever, const Vector_& box, const Vector_& r,
              const Vector_& w, Jet& turned, Jet& gap) {
    distance_.resize(steps.size());
    double reach = 0;
    for (int k = int(steps.size()) - 1; k >= 0; --k) {
      distance_[k] = lever[k] + (steps[k].turn ? reach : 0);
      reach += box[steps[k].column] * distance_[k];
    }
    gap.size += reach;
    double a = 0, b = 0;  // turns so far, along r and along w
    for (size_t k = 0; k < steps.size(); ++k) {
      const double x = r[steps[k].column], y = w[steps[k].column], d = distance_[k];
      gap.r += x * d, gap.w += y * d;
      if (!steps[k].turn) {
        gap.rr += 2 * a * x, gap.rw += a * y + b * x, gap.rrw += a * (2 * b * x + a * y);
        continue;
      }
      const double a1 = a + x, b1 = b + y;
      gap.rr += d * (a1 * a1 - a * a), gap.rw += d * (a1 * b1 - a * b), gap.rrw += d * (a1 * a1 * b1 - a * a * b);
      a = a1, b = b1;
    }
    turned = {1, a, b, a * a, a * b, a * a * b};
  }

  static double slope_bound(const CouplingTerm& term, double far, int order) {
    double total = 0;
    for (int k = int(term.coefficients.size()) - 1; k >= order; --k) {
      double factor = std::abs(term.coefficients[k]);
      for (int d = 0; d < order; ++d) factor *= k - d;
      total = total * far + factor;
    }
    return total;
  }

  void component_bounds(const Coordinate& k, double angle, const Vector_& box, const Vector_& r, const Vector_& w,
                        double& second, double& third) const {
    second = third = 0;
    if (k.component >= 3 && k.kind == Kind::planar) return;
    const Joint& joint = m.joints[k.joint];
    const int first = m.column_of[joint.v], slides = k.kind == Kind::planar ? 2 : k.kind == Kind::floating ? 3 : 0;
    double turn_r = 0, turn_w = 0, turn = 0, slide_r = 0, slide_w = 0, far = 0;
    for (int i = 0; i < joint.nv; ++i) {
      const double x = r[first + i], y = w[first + i], b = box[first + i];
      if (i < slides) slide_r += x, slide_w += y, far += b;
      else turn_r += x, turn_w += y, turn += b;
    }
    if (k.component < 3) {
      second = turn_r * slide_w + turn_w * slide_r + turn_r * turn_w * far;
      third = turn_r * (2 * turn_w * slide_r + turn_r * slide_w + turn_r * turn_w * far);
      return;
    }
    const double t = std::max(angle + turn, 0.5);
    if (!(t < M_PI)) {
      second = third = INFINITY;
      return;
    }
    const double cot = 1 / std::tan(0.5 * t), csc = 1 / std::sin(0.5 * t);
    const double g = 2 + 0.5 * t - 0.5 * t * cot, g1 = 0.5 - 0.5 * cot + 0.25 * t * csc * csc;
    const double g2 = 0.5 * csc * csc - 0.25 * t * csc * csc * cot, s = g1 * g + 0.5 * g;
    second = s * turn_r * turn_w;
    third = (g2 * g * g + g1 * s + g1 * g + g / 3) * turn_r * turn_r * turn_w;
  }

  // |ψ_q′⁻¹| times `rows_`, by local column.
  void spread(const Cluster& c, const ProofStart& start, Vector_& out) {
    const int n = c.unknowns();
    unknown_.assign(n, 0.), out.assign(c.width(), 0.);
    for (int r = 0; r < c.rows(); ++r) add(unknown_.data(), rows_[r], start.size.data() + size_t(r) * n, n);
    for (int k = 0; k < n; ++k) out[c.dependent[k]] = unknown_[k];
  }
  static void add(double* y, double f, const double* x, int n) {
    for (int k = 0; k < n; ++k) y[k] += f * x[k];
  }
  void second(const Cluster& c, const ProofStart& start, const Vector_& r, Vector_& out) {
    rows_.assign(c.rows(), 0.);
    bounds(c, start, r, r, r, 1, 0);
    spread(c, start, out);
  }

  // (i) of the theorem for steps within u.
  bool around(const Cluster& c, const ProofStart& start, const Vector_& u, Vector_& radius) {
    second(c, start, u, bent_);
    double most = 0, largest = 0;
    for (int k = 0; k < c.width(); ++k) {
      radius[k] = u[k] + 2 * bent_[k];
      most = std::max(most, bent_[k]), largest = std::max(largest, u[k]);
    }
    if (!(most <= 2 * largest)) return false;
    second(c, start, radius, image_);
    for (int k : c.dependent)
      if (!(image_[k] <= kBelowOne * radius[k] && 0.5 * image_[k] <= 2 * bent_[k])) return false;
    return true;
  }

  // (ii), for as much of the step as it holds for.
  double along(const Cluster& c, ClusterState& s, ProofStart& start) {
    const int unknowns = c.unknowns(), width = c.width();
    step_ = s.step;
    bias(c, s, step_.data());
    sag_.assign(width, 0.);
    for (int k : c.dependent) sag_[k] = 0.5 * std::abs(s.bias[k]);
    turning_.assign(size_t(width) * unknowns, 0.);
    jacobian_rate(c, s, step_.data(), [&](int row, int col, double rate) {
      add(turning_.data() + size_t(col) * unknowns, rate, start.inverse.data() + size_t(row) * unknowns, unknowns);
    });
    bend_.resize(size_t(unknowns) * unknowns);
    for (int i = 0; i < unknowns; ++i)
      std::copy_n(turning_.data() + size_t(c.dependent[i]) * unknowns, unknowns, bend_.data() + size_t(i) * unknowns);
    straighten(c);
    for (double& x : bend_) x = std::abs(x);
    part_ = 1;
    for (int trial = 0; trial < kTrials; ++trial) {
      if (tube(c, start)) {
        for (int k = 0; k < width; ++k) centre_[k] = part_ * step_[k];
        return part_;
      }
      const double likely = trial ? 0 : kLikely / std::max(growth(c), 1e-300);
      part_ = likely > 0 && likely < 0.6 ? likely : 0.6 * part_;
    }
    return part_ = likely_ = 0;
  }

  // ψ_q′⁻¹ψ̇_q′(u), in which velocities are those of moving frames, made ψ_q′⁻¹ψ″[u, ·] in exponential coordinates.
  void straighten(const Cluster& c) {
    const int unknowns = c.unknowns();
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      if (joint.kind != Kind::spherical && joint.kind != Kind::planar && joint.kind != Kind::floating) continue;
      const int first = m.column_of[joint.v];
      const double* v = step_.data() + first;
      const bool planar = joint.kind == Kind::planar, slides = joint.kind == Kind::floating;
      const Vec3 w = planar ? Vec3(0, 0, v[2]) : slides ? Vec3(v[3], v[4], v[5]) : Vec3(v[0], v[1], v[2]);
      const Vec3 x = planar ? Vec3(v[0], v[1], 0) : slides ? Vec3(v[0], v[1], v[2]) : Vec3(0, 0, 0);
      Eigen::Matrix<double, 6, 6> bracket = Eigen::Matrix<double, 6, 6>::Zero();
      bracket.topLeftCorner<3, 3>() = bracket.bottomRightCorner<3, 3>() = skew(w);
      bracket.topRightCorner<3, 3>() = skew(x);
      const int entry[6] = {planar || slides ? 0 : 3, planar || slides ? 1 : 4, planar ? 5 : slides ? 2 : 5, 3, 4, 5};
      for (int a = 0; a < unknowns; ++a)
        for (int b = 0; b < unknowns; ++b) {
          const int p = c.dependent[a] - first, q = c.dependent[b] - first;
          if (p < 0 || q < 0 || p >= joint.nv || q >= joint.nv) continue;
          bend_[size_t(b) * unknowns + a] -= 0.5 * bracket(entry[p], entry[q]);
        }
    }
  }

  double growth(const Cluster& c) {
    const int unknowns = c.unknowns();
    Vector_ &x = w_, &y = need_;
    x.resize(unknowns);
    for (int k = 0; k < unknowns; ++k) x[k] = u_[c.dependent[k]];
    double found = 0;
    for (int round = 0; round < 4; ++round) {
      double before = 0, after = 0;
      y.assign(unknowns, 0.);
      for (int i = 0; i < unknowns; ++i) add(y.data(), x[i], bend_.data() + size_t(i) * unknowns, unknowns);
      for (int k = 0; k < unknowns; ++k) before += x[k] * x[k], after += y[k] * y[k];
      found = std::sqrt(after / before);
      if (!(found > 0)) return 0;
      std::swap(x, y);
    }
    return found;
  }

  bool tube(const Cluster& c, const ProofStart& start) {
    const int width = c.width();
    part_u_.resize(width), part_sag_.assign(width, 0.), part_bend_ = bend_, box_.resize(width);
    double largest = 0;
    for (int k = 0; k < width; ++k) part_u_[k] = part_ * u_[k] + noise_[k], largest = std::max(largest, part_u_[k]);
    for (int k : c.dependent) part_sag_[k] = part_ * part_ * sag_[k] + noise_[k];
    for (double& x : part_bend_) x *= part_;
    if (!guess(c, largest)) return false;
    for (int round = 0; round < kRounds; ++round) {
      for (int k = 0; k < width; ++k) box_[k] = part_u_[k] + radius_[k];
      rows_.assign(c.rows(), 0.);
      bounds(c, start, box_, radius_, radius_, 0.5, 0);
      bounds(c, start, box_, box_, box_, 0, 1. / 6);
      spread(c, start, image_);
      bend(c, radius_);
      bool good = true;
      double most = 0;
      for (int a = 0; a < c.unknowns(); ++a) {
        const int k = c.dependent[a];
        need_[a] += part_sag_[k] + image_[k];
        good &= need_[a] <= radius_[k];
      }
      if (good) return contracts(c, start);
      for (int a = 0; a < c.unknowns(); ++a) {
        double& x = radius_[c.dependent[a]];
        x = std::max(x, 1.1 * need_[a]), most = std::max(most, x);
      }
      if (!(most <= 3 * largest)) return false;
    }
    return false;
  }
  // |N| x, by unknown, into `need_`.
  void bend(const Cluster& c, const Vector_& x) {
    const int n = c.unknowns();
    need_.assign(n, 0.);
    for (int i = 0; i < n; ++i) add(need_.data(), x[c.dependent[i]], part_bend_.data() + size_t(i) * n, n);
  }

  bool contracts(const Cluster& c, const ProofStart& start) {
    for (int round = 0; round < kRounds; ++round) {
      rows_.assign(c.rows(), 0.);
      bounds(c, start, box_, radius_, w_, 1, 0);
      bounds(c, start, box_, box_, w_, 0, 0.5);
      spread(c, start, image_);
      bend(c, w_);
      bool all = true, none = true;
      for (int a = 0; a < c.unknowns(); ++a) {
        const int k = c.dependent[a];
        need_[a] += image_[k];
        (need_[a] <= kBelowOne * w_[k] ? none : all) = false;
      }
      if (all) return true;
      if (none) return false;
      for (int a = 0; a < c.unknowns(); ++a) {
        double& x = w_[c.dependent[a]];
        x = std::max(need_[a], 0.5 * x);
      }
    }
    return false;
  }

  // ε and w to begin with: (1 − |N|) ε = 1.1 sag and (1 − |N|) w = u, by elimination, which needs no pivots where |N| < 1.
  bool guess(const Cluster& c, double largest) {
    const int n = c.unknowns(), wide = n + 2;
    elimination_.resize(size_t(n) * wide), radius_.assign(c.width(), 0.), w_.assign(c.width(), 0.), need_.resize(n);
    for (int k = 0; k < n; ++k) {
      double* row = elimination_.data() + size_t(k) * wide;
      for (int i = 0; i < n; ++i) row[i] = (i == k) - part_bend_[size_t(i) * n + k];
      row[n] = 1.1 * part_sag_[c.dependent[k]], row[n + 1] = std::max(part_u_[c.dependent[k]], 0.05 * largest);
    }
    for (int k = 0; k < n; ++k) {
      const double* top = elimination_.data() + size_t(k) * wide;
      if (!(top[k] > 0)) return false;
      for (int r = k + 1; r < n; ++r) {
        double* row = elimination_.data() + size_t(r) * wide;
        const double f = row[k] / top[k];
        if (f != 0)
          for (int i = k; i < wide; ++i) row[i] -= f * top[i];
      }
    }
    for (int k = n - 1; k >= 0; --k) {
      const double* row = elimination_.data() + size_t(k) * wide;
      double x = row[n], y = row[n + 1];
      for (int i = k + 1; i < n; ++i) x -= row[i] * radius_[c.dependent[i]], y -= row[i] * w_[c.dependent[i]];
      radius_[c.dependent[k]] = std::max(x / row[k], part_sag_[c.dependent[k]]);
      w_[c.dependent[k]] = y / row[k];
    }
    double growth = 0.5 * kLikely;  // Collatz and Wielandt: at least the spectral radius of |N|
    for (int k = 0; k < n; ++k)
      growth = std::max(growth, 1 - std::max(part_u_[c.dependent[k]], 0.05 * largest) / w_[c.dependent[k]]);
    likely_ = kLikely / growth;
    return true;
  }
};

}  // namespace ccpin
