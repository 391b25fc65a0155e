// Bounds of φ and φ_θ over one box: what Theorem N needs. Theorems, notation and margins are those of
// `proof/bounds.py`; `closures.hpp` proves γ for the operations here.
#pragma once
#include "closures.hpp"

#include <algorithm>
#include <memory>

namespace ccpin::certificates {

// θ = θ_c + Dδ + Eζ, |δ| ≤ h, |ζ| ≤ R: the fields of `Boxes`, row-major.
struct Box {
  Doubles centre, half, directions, modes, preconditioner, radius, weight;
  double kappa = 1;
  bool plain = true;  // V = I

  int parameters() const { return int(half.size()); }
};

// y += factor · x over `size` entries.
inline void add_scaled(double* y, double factor, const double* x, int size) {
  for (int k = 0; k < size; ++k) y[k] += factor * x[k];
}

// h + 1e-14 + 4u(|c| + h), the half width of the box that a theorem is about (`ccpin.proof.rounding`).
inline double widened(double centre, double half) { return half + (1e-14 + 0x1p-51 * (std::abs(centre) + half)); }

// What a point at which a question is asked may be off by.
inline double blur(double point) { return 0x1p-51 * (1 + std::abs(point)); }

// What parameter e is measured from (`measured_from` of `proof/newton.py`).
inline double measured_from(const Closures& closures, const Box& box, int e) {
  if (box.parameters() == closures.n) return box.centre[closures.independent[e]];
  double largest = 0;
  for (double x : box.centre) largest = std::max(largest, std::abs(x));
  return largest;
}

// Whether parameters are of the box that its theorem is about (`within` of `proof/newton.py`).
inline bool within(const Closures& closures, const Box& box, const double* delta) {
  for (int e = 0; e < box.parameters(); ++e)
    if (!(std::abs(delta[e]) <= widened(measured_from(closures, box, e), box.half[e]))) return false;
  return true;
}

// A bound in two parts: a matrix (m, m), kept column by column, to be applied to a vector, and what to add.
struct Image {
  Doubles columns, rest;

  void of(const double* vector, Doubles& out) const {
    const int m = int(rest.size());
    out = rest;
    for (int k = 0; k < m; ++k) add_scaled(out.data(), vector[k], &columns[k * m], m);
  }
};

class Bounds {
 public:
  Doubles y;  // Y ≥ |f(δ, 0)|

  explicit Bounds(const Closures& c) : closures(c) {}
  virtual ~Bounds() = default;

  void set(const Box& box, const Values& at) {
    linear(box, at);
    curved(box, at);
  }
  virtual void mean(const Doubles& radius, Image& out) = 0;                                // Z̄(R)
  virtual void contraction(const Doubles& radius, const Doubles& weight, Image& out) = 0;  // Z(R)

 protected:
  const Closures& closures;
  int p = 0;                                    // parameters
  bool plain = true;
  Doubles half, moves, lines, spread, sums;  // h widened; L = |D|h; Dᵀ (p, n′); |V|; Σ_k |V|_ke
  Doubles defect, margin, weighted;             // |I − Ãφ_θE|, by columns; Σ_j |Ã_ij| γ · magnitude; Ãφ_θ (m, n′)
  double rounding = 0;                          // γ · magnitude

  virtual void curved(const Box& box, const Values& at) = 0;

  // |E|R in the dependent coordinates, zero elsewhere, of shape (n′,).
  void widths(const Doubles& radius, Doubles& out) const {
    const int m = closures.m;
    out.assign(closures.n_free, 0.);
    for (int k = 0; k < m; ++k) {
      double sum = plain ? radius[k] : 0;
      for (int e = 0; !plain && e < m; ++e) sum += spread[k * m + e] * radius[e];
      out[closures.dependent[k]] = sum;
    }
  }

  // |I − Ãφ_θE| with the rounding margin of everything in Z, by columns.
  void affine(const Doubles& width, Doubles& matrix) const {
    const int m = closures.m;
    double size = 1;
    for (int k = 0; k < closures.n_free; ++k) size += moves[k] + width[k];
    matrix = defect;
    for (int e = 0; e < m; ++e) add_scaled(&matrix[e * m], sums[e] * size, margin.data(), m);
  }

 private:
  void linear(const Box& box, const Values& at) {
    const int m = closures.m, n_free = closures.n_free;
    p = box.parameters(), plain = box.plain;
    half.resize(p), moves.assign(n_free, 0.), lines.resize(size_t(p) * n_free);
    for (int e = 0; e < p; ++e) {
      half[e] = widened(measured_from(closures, box, e), box.half[e]);
      for (int k = 0; k < n_free; ++k) {
        lines[e * n_free + k] = box.directions[k * p + e];
        moves[k] += std::abs(lines[e * n_free + k]) * half[e];
      }
    }
    spread.resize(size_t(m) * m), sums.assign(m, 0.);
    for (int k = 0; k < m; ++k)
      for (int e = 0; e < m; ++e) sums[e] += spread[k * m + e] = std::abs(box.modes[k * m + e]);
    rounding = closures.gamma * closures.magnitude(box.centre.data());
    weighted.assign(size_t(m) * n_free, 0.);
    const double* A = box.preconditioner.data();
    for (int i = 0; i < m; ++i)
      for (int k = 0; k < m; ++k) add_scaled(&weighted[i * n_free], A[i * m + k], &at.jacobian[k * n_free], n_free);
    constant(A, at.phi);
    find_defect(box.modes);
  }

  // |Ãφ_c| + |Ãφ_θD|h with its rounding margin, the start of Y.
  void constant(const double* A, const Doubles& phi) {
    const int m = closures.m, n_free = closures.n_free;
    double size = 1;
    for (double x : moves) size += x;
    y.resize(m), margin.resize(m);
    for (int i = 0; i < m; ++i) {
      double residual = 0, gain = 0, slope = 0;
      for (int k = 0; k < m; ++k) residual += A[i * m + k] * phi[k], gain += std::abs(A[i * m + k]);
      for (int e = 0; e < p; ++e) {
        double along = 0;
        for (int k = 0; k < n_free; ++k) along += weighted[i * n_free + k] * lines[e * n_free + k];
        slope += std::abs(along) * half[e];
      }
      margin[i] = gain * rounding;
      y[i] = std::abs(residual) + slope + margin[i] * (size * size);
    }
  }

  void find_defect(const Doubles& modes) {
    const int m = closures.m, n_free = closures.n_free;
    defect.assign(size_t(m) * m, 0.);
    for (int i = 0; i < m; ++i)
      for (int e = 0; e < m; ++e) {
        const double* row = &weighted[i * n_free];
        double entry = plain ? row[closures.dependent[e]] : 0;
        for (int k = 0; !plain && k < m; ++k) entry += row[closures.dependent[k]] * modes[k * m + e];
        defect[e * m + i] = std::abs((i == e) - entry);
      }
  }
};

}  // namespace ccpin::certificates
