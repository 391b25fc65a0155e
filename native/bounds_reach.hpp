// Reach bounds, for any tree: exact second derivatives at the centre, link lengths for the third (`proof/bounds.py`).
#pragma once
#include "bounds.hpp"

namespace ccpin::certificates {

class ReachBounds final : public Bounds {
 public:
  explicit ReachBounds(const Closures& c) : Bounds(c) {
    std::vector<int> mode(c.n_free, -1), entry(size_t(c.n_free) * c.n_free, -1);
    for (int k = 0; k < c.m; ++k) mode[c.dependent[k]] = k;
    for (const Chain& chain : c.chains)
      for (size_t j = 0; j < chain.joints.size(); ++j)
        for (size_t i = 0; i <= j; ++i)
          if (!chain.joints[i].slides && !(i == j && chain.joints[j].slides)) {
            const int a = chain.joints[i].column, b = chain.joints[j].column;
            const int key = std::min(a, b) * c.n_free + std::max(a, b);
            if (entry[key] < 0) entry[key] = int(entries_.size()), entries_.push_back({a, b, mode[a], mode[b]});
            pairs_.push_back({chain.first + int(i), chain.first + int(j), int(&chain - c.chains.data()), entry[key]});
          }
    for (const Entry& e : entries_)
      if (e.mode >= 0 && e.other_mode >= 0) sparse_.push_back({e.mode, e.other_mode});
    for (int f = 0; f < c.m; ++f)
      for (int e = 0; e <= f; ++e) all_.push_back({e, f});
    arms_.resize(c.joints), reach_.resize(c.joints);
  }

  void mean(const Doubles& radius, Image& out) override {
    widths(radius, width_), box_of(width_);
    affine(width_, out.columns), add_first(radius, 0.5, out.columns);
    third(out, [&](const Chain& c) {
      return trilinear(c, moves, moves, width_) + trilinear(c, moves, width_, width_) +
             trilinear(c, width_, width_, width_) / 3;
    });
  }

  void contraction(const Doubles& radius, const Doubles& weight, Image& out) override {
    widths(radius, width_), widths(weight, other_), box_of(width_);
    affine(width_, out.columns), add_first(radius, 1, out.columns);
    third(out, [&](const Chain& c) { return trilinear(c, box_, box_, other_); });
  }

 private:
  // What enters φ_θθ: ∂²x/∂θ_i∂θ_j = a_i × b_j of a chain, i not deeper than j.
  struct Pair {
    int upper, deeper, chain, entry;
  };
  // An entry of φ_θθ that is not always zero, in θ and among the dependent coordinates (−1: independent).
  struct Entry {
    int row, column, mode, other_mode;
  };
  struct Mixed {
    int mode, other;
  };
  std::vector<Pair> pairs_;
  std::vector<Entry> entries_;
  std::vector<Mixed> sparse_, all_;  // the entries of N in the modes, above its diagonal: with V = I, and with any V
  // Everything with m entries in its last axis has one for each row of Ãφ.
  Doubles weights_, gains_;             // ÃB_c (C, 3, m) and g (C, m)
  Doubles hessian_, along_;             // Ãφ_θθ (entries, m), its product with D (p, n′, m)
  Doubles mixed_, constant_;            // |N| in the modes (sparse or all, m); |N|h (m, m) by columns
  Doubles arms_, reach_, size_, box_;   // |b|, ρ by joint; |θ_c|; the joints' moves
  Doubles width_, other_, turned_, line_;

  void curved(const Box& box, const Values& at) override {
    const int m = closures.m;
    size_.resize(closures.n_free);
    for (int k = 0; k < closures.n_free; ++k) size_[k] = std::abs(box.centre[k]);
    for (int k = 0; k < closures.joints; ++k) arms_[k] = at.b[k].norm();
    weigh(box.preconditioner), weigh_second(at), add_quadratic();
    mix_lines(box.modes), mix_modes(box.modes);
    box_ = moves;
    Image cubic;
    cubic.rest.resize(m);
    third(cubic, [&](const Chain& c) { return trilinear(c, moves, moves, moves); });
    for (int i = 0; i < m; ++i) y[i] += cubic.rest[i] / 3;
  }

  // The rows of ÃB_c and their lengths g_c.
  void weigh(const Doubles& A) {
    const int m = closures.m, count = int(closures.chains.size());
    weights_.assign(size_t(count) * 3 * m, 0.), gains_.resize(size_t(count) * m);
    for (int c = 0; c < count; ++c) {
      double* w = &weights_[c * 3 * m];
      for (const ChainRow& r : closures.chains[c].rows)
        for (int x = 0; x < 3; ++x)
          for (int i = 0; i < m; ++i) w[x * m + i] += A[i * m + r.row] * r.weight[x];
      for (int i = 0; i < m; ++i)
        gains_[c * m + i] = std::sqrt(w[i] * w[i] + w[m + i] * w[m + i] + w[2 * m + i] * w[2 * m + i]);
    }
  }

  // Ãφ_θθ and its product with D.
  void weigh_second(const Values& at) {
    const int m = closures.m, n_free = closures.n_free;
    hessian_.assign(entries_.size() * m, 0.), along_.assign(size_t(p) * n_free * m, 0.);
    for (const Pair& pair : pairs_) {
      const V3 second = at.a[pair.upper].cross(at.b[pair.deeper]);
      for (int x = 0; x < 3; ++x)
        add_scaled(&hessian_[pair.entry * m], second[x], &weights_[(pair.chain * 3 + x) * m], m);
    }
    const double* line = hessian_.data();
    for (const Entry& entry : entries_) {
      for (int e = 0; e < p; ++e) {
        double* along = &along_[e * n_free * m];
        add_scaled(along + entry.row * m, lines[e * n_free + entry.column], line, m);
        if (entry.row != entry.column) add_scaled(along + entry.column * m, lines[e * n_free + entry.row], line, m);
      }
      line += m;
    }
  }

  // Y += ½ hᵀ|Dᵀ(Ãφ_θθ)D|h.
  void add_quadratic() {
    const int m = closures.m, n_free = closures.n_free;
    for (int e = 0; e < p; ++e)
      for (int f = 0; f <= e; ++f) {
        line_.assign(m, 0.);
        for (int k = 0; k < n_free; ++k) add_scaled(line_.data(), lines[f * n_free + k], &along_[(e * n_free + k) * m], m);
        const double factor = (e == f ? 0.5 : 1) * half[e] * half[f];
        for (int i = 0; i < m; ++i) y[i] += factor * std::abs(line_[i]);
      }
  }

  // |N|h: the columns of |Eᵀ(Ãφ_θθ)D| times h.
  void mix_lines(const Doubles& modes) {
    const int m = closures.m, n_free = closures.n_free;
    constant_.assign(size_t(m) * m, 0.);
    for (int w = 0; w < p; ++w)
      for (int e = 0; e < m; ++e) {
        const double *along = &along_[w * n_free * m], *line = along + closures.dependent[e] * m;
        if (!plain) {
          line_.assign(m, 0.), line = line_.data();
          for (int k = 0; k < m; ++k)
            add_scaled(line_.data(), modes[k * m + e], along + closures.dependent[k] * m, m);
        }
        for (int i = 0; i < m; ++i) constant_[e * m + i] += half[w] * std::abs(line[i]);
      }
  }

  // |N| in the modes: |Eᵀ(Ãφ_θθ)E|.
  void mix_modes(const Doubles& modes) {
    const int m = closures.m;
    mixed_.assign((plain ? sparse_ : all_).size() * m, 0.);
    double* out = mixed_.data();
    const double* line = hessian_.data();
    if (!plain) turned_.assign(size_t(m) * m * m, 0.);
    for (const Entry& entry : entries_) {
      const int a = entry.mode, b = entry.other_mode;
      if (plain && a >= 0 && b >= 0) std::copy_n(line, m, out), out += m;
      for (int f = 0; !plain && a >= 0 && b >= 0 && f < m; ++f) {
        add_scaled(&turned_[(f * m + a) * m], modes[b * m + f], line, m);
        if (a != b) add_scaled(&turned_[(f * m + b) * m], modes[a * m + f], line, m);
      }
      line += m;
    }
    if (!plain)
      for (const Mixed& x : all_) {
        for (int k = 0; k < m; ++k) add_scaled(out, modes[k * m + x.mode], &turned_[(x.other * m + k) * m], m);
        out += m;
      }
    for (double& x : mixed_) x = std::abs(x);
  }

  // matrix += |N|(h, part · R), by columns.
  void add_first(const Doubles& radius, double part, Doubles& matrix) const {
    const int m = closures.m;
    for (int k = 0; k < m * m; ++k) matrix[k] += constant_[k];
    const double* line = mixed_.data();
    for (const Mixed& x : plain ? sparse_ : all_) {
      add_scaled(&matrix[x.mode * m], part * radius[x.other], line, m);
      if (x.mode != x.other) add_scaled(&matrix[x.other * m], part * radius[x.mode], line, m);
      line += m;
    }
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
    double length = c.tip_length, drift = 0;
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
