// Reach bounds, for any tree: exact second derivatives at the centre, link lengths for the third (`domain/bounds_reach.py`).
#pragma once
#include "bounds.hpp"

namespace ccpin::certificates {

class ReachBounds final : public Bounds {
 public:
  explicit ReachBounds(const Closures& c) : Bounds(c) {
    for (const Chain& chain : c.chains)
      for (size_t j = 0; j < chain.joints.size(); ++j)
        for (size_t i = 0; i <= j; ++i)
          if (!chain.joints[i].slides && !(i == j && chain.joints[j].slides))
            pairs_.push_back({chain.first + int(i), chain.first + int(j), int(&chain - c.chains.data()),
                              chain.joints[i].column, chain.joints[j].column});
    second_.resize(pairs_.size()), arms_.resize(c.joints), reach_.resize(c.joints);
  }

  void mean(const Doubles& radius, Image& out) override {
    half_radius_ = radius;
    for (double& r : half_radius_) r *= 0.5;
    widths(radius, width_), box_of(width_);
    affine(width_, out.matrix), add_first(half_radius_, out.matrix);
    third(out, [&](const Chain& c) {
      return trilinear(c, moves, moves, width_) + trilinear(c, moves, width_, width_) +
             trilinear(c, width_, width_, width_) / 3;
    });
  }

  void contraction(const Doubles& radius, const Doubles& weight, Image& out) override {
    widths(radius, width_), widths(weight, other_), box_of(width_);
    affine(width_, out.matrix), add_first(radius, out.matrix);
    third(out, [&](const Chain& c) { return trilinear(c, box_, box_, other_); });
  }

 private:
  // ∂²x/∂θ_i∂θ_j = a_i × b_j of a chain, i not deeper than j; where they are in θ.
  struct Pair {
    int upper, deeper, chain, row, column;
  };
  std::vector<Pair> pairs_;
  std::vector<V3> second_, weights_;               // a × b; the rows of ÃB_c, (C, m)
  Doubles gains_, mixed_;                          // g (C, m); |N|, (m, p + m, m): row, (δ, ζ), mode
  Doubles arms_, reach_, size_, box_;              // |b|, ρ by joint; |θ_c|; the joints' moves
  Doubles hessian_, along_, width_, other_, half_radius_;

  void curved(const Box& box, const Values& at) override {
    const int m = closures.m;
    size_.resize(closures.n_free);
    for (int k = 0; k < closures.n_free; ++k) size_[k] = std::abs(box.centre[k]);
    for (int k = 0; k < closures.joints; ++k) arms_[k] = at.b[k].norm();
    for (size_t k = 0; k < pairs_.size(); ++k) second_[k] = at.a[pairs_[k].upper].cross(at.b[pairs_[k].deeper]);
    weigh(box.preconditioner);
    mixed_.resize(size_t(m) * (p + m) * m);
    for (int i = 0; i < m; ++i) {
      weigh_second(i);
      y[i] += 0.5 * quadratic();
      mix(i, box.modes);
    }
    box_ = moves;
    Image cubic;
    cubic.rest.resize(m);
    third(cubic, [&](const Chain& c) { return trilinear(c, moves, moves, moves); });
    for (int i = 0; i < m; ++i) y[i] += cubic.rest[i] / 3;
  }

  // The rows of ÃB_c and their lengths g_c.
  void weigh(const Doubles& A) {
    const size_t m = closures.m, count = closures.chains.size();
    weights_.assign(count * m, V3::Zero()), gains_.resize(count * m);
    for (size_t c = 0; c < count; ++c)
      for (size_t i = 0; i < m; ++i) {
        for (const ChainRow& r : closures.chains[c].rows) weights_[c * m + i] += A[i * m + r.row] * r.weight;
        gains_[c * m + i] = weights_[c * m + i].norm();
      }
  }

  // Row i of Ãφ_θθ (n′, n′), and its product with D, (p, n′).
  void weigh_second(int i) {
    const int m = closures.m, n_free = closures.n_free;
    hessian_.assign(size_t(n_free) * n_free, 0.), along_.assign(size_t(p) * n_free, 0.);
    for (size_t k = 0; k < pairs_.size(); ++k) {
      const Pair& pair = pairs_[k];
      const double entry = weights_[pair.chain * m + i].dot(second_[k]);
      hessian_[pair.row * n_free + pair.column] += entry;
      if (pair.row != pair.column) hessian_[pair.column * n_free + pair.row] += entry;
    }
    for (int e = 0; e < p; ++e)
      for (int k = 0; k < n_free; ++k)
        if (lines[e * n_free + k] != 0)
          add_scaled(&along_[e * n_free], lines[e * n_free + k], &hessian_[k * n_free], n_free);
  }

  // hᵀ|Dᵀ(Ãφ_θθ)_iD|h.
  double quadratic() const {
    const int n_free = closures.n_free;
    double sum = 0;
    for (int e = 0; e < p; ++e)
      for (int f = 0; f < p; ++f) {
        double entry = 0;
        for (int k = 0; k < n_free; ++k) entry += along_[e * n_free + k] * lines[f * n_free + k];
        sum += half[e] * std::abs(entry) * half[f];
      }
    return sum;
  }

  // |N_i| = |Eᵀ(Ãφ_θθ)_i[D, E]|, transposed.
  void mix(int i, const Doubles& modes) {
    const int m = closures.m, n_free = closures.n_free;
    const std::vector<int>& dependent = closures.dependent;
    double* out = &mixed_[size_t(i) * (p + m) * m];
    for (int w = 0; w < p + m; ++w, out += m) {
      const double* line = w < p ? &along_[w * n_free] : &hessian_[dependent[w - p] * n_free];
      if (!plain && w >= p) {
        other_.assign(n_free, 0.);
        for (int k = 0; k < m; ++k) add_scaled(other_.data(), modes[k * m + w - p], &hessian_[dependent[k] * n_free], n_free);
        line = other_.data();
      }
      if (plain) {
        for (int e = 0; e < m; ++e) out[e] = std::abs(line[dependent[e]]);
        continue;
      }
      std::fill(out, out + m, 0.);
      for (int k = 0; k < m; ++k) add_scaled(out, line[dependent[k]], &modes[k * m], m);
      for (int e = 0; e < m; ++e) out[e] = std::abs(out[e]);
    }
  }

  // matrix += |N|(h, r).
  void add_first(const Doubles& radius, Doubles& matrix) const {
    const int m = closures.m;
    const double* line = mixed_.data();
    for (int i = 0; i < m; ++i)
      for (int w = 0; w < p + m; ++w, line += m) add_scaled(&matrix[i * m], w < p ? half[w] : radius[w - p], line, m);
  }

  // The joints' moves |D|h + |E|R, and how far every tip is at most from every axis over them.
  void box_of(const Doubles& width) {
    box_ = moves;
    for (int k = 0; k < closures.n_free; ++k) box_[k] += width[k];
  }

  // rest = ½ Σ_c g_c T_c.
  template <class T> void third(Image& out, T&& tensor) {
    const int m = closures.m;
    out.rest.assign(m, 0.);
    for (size_t c = 0; c < closures.chains.size(); ++c) {
      find_reach(closures.chains[c]);
      add_scaled(out.rest.data(), 0.5 * tensor(closures.chains[c]), &gains_[c * m], m);
    }
  }

  // ρ ≥ |b| of a chain's joints wherever the joints move by at most `box_` (`chain_reach`).
  void find_reach(const Chain& c) {
    double length = c.tip.norm(), drift = 0;
    for (int k = int(c.joints.size()) - 1; k >= 0; --k) {
      const ChainJoint& j = c.joints[k];
      const bool travels = j.slides && !c.direction;
      if (travels) length += size_[j.column] + box_[j.column];
      double& reach = reach_[c.first + k];
      reach = j.slides ? (travels ? 1 : 0) : std::min(length, arms_[c.first + k] + rounding + drift);
      drift += reach * box_[j.column];
      if (!c.direction) length += j.length;
    }
  }

  // T_c(x, y, z): by deepest joint, the other two summed over turning joints not deeper.
  double trilinear(const Chain& c, const Doubles& x, const Doubles& y, const Doubles& z) const {
    double sum = 0, x_above = 0, y_above = 0, y_to = 0, z_to = 0;
    for (size_t k = 0; k < c.joints.size(); ++k) {
      const ChainJoint& j = c.joints[k];
      const double xk = x[j.column], yk = y[j.column], zk = z[j.column];
      if (!j.slides) y_to += yk, z_to += zk;
      sum += reach_[c.first + k] * ((xk * y_to + x_above * yk) * z_to + x_above * y_above * zk);
      if (!j.slides) x_above += xk;
      y_above = y_to;
    }
    return sum;
  }
};

}  // namespace ccpin::certificates
