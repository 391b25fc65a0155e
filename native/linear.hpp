// Linear algebra for the few unknowns of one cluster: row-major, in place, no allocation.
#pragma once
#include <algorithm>
#include <cmath>
#include <type_traits>
#include <vector>

namespace ccpin {

// f(n), with an n known to the compiler where it is small.
template <class F> void with_width(int n, F&& f) {
  switch (n) {
    case 1: return f(std::integral_constant<int, 1>());
    case 2: return f(std::integral_constant<int, 2>());
    case 3: return f(std::integral_constant<int, 3>());
    case 4: return f(std::integral_constant<int, 4>());
    case 5: return f(std::integral_constant<int, 5>());
    case 6: return f(std::integral_constant<int, 6>());
    default: return f(n);
  }
}

// Where a cluster's matrix is not zero. Each loop has unknowns of its own, that occur in its rows only, and shares the
// others (those of a platform) with other loops: a bordered block diagonal. Eliminating each block's own unknowns within
// its rows, and the shared ones from what rows are left, is Gaussian elimination (or Householder's) in that order of
// columns with the products of zeros left out, so its pivots are the dense ones.
struct Block {
  std::vector<int> rows;  // in which its unknowns occur
  int first, end;         // its unknowns
};
struct Pattern {
  int rows = 0, n = 0;
  int shared = 0;             // the first of the unknowns that blocks share
  std::vector<Block> blocks;  // the last is that of the shared unknowns and the rows left
  std::vector<int> slots;     // by unknown: the row that the solution stands in
};

// That of a matrix without zeros.
inline Pattern dense(int rows, int n) {
  Pattern p{rows, n, 0, {}, {}};
  Block all{{}, 0, std::min(rows, n)};
  for (int r = 0; r < rows; ++r) all.rows.push_back(r);
  p.slots.assign(all.rows.begin(), all.rows.begin() + all.end);
  p.blocks.push_back(all);
  return p;
}

// ψ_q′ restricted to a cluster's dependent columns: LU with partial pivoting where square, Householder QR where
// redundant rows make it tall (least squares).
struct Factor {
  const Pattern* pattern;
  double* a;           // rows × n, row-major
  int* pivot;          // n
  double* diagonal;    // n (tall only)
  int rows, n;
  int sign = 0;        // of the determinant; 0 where tall
  double ratio = 0;    // smallest over largest pivot, 0 where singular: a cheap first look at the conditioning

  void factorize() { rows == n ? lu() : qr(); }

  // x (rows × k, row-major) becomes the solution, unknown i in row slots[i].
  void solve(double* x, int k) const {
    if (rows != n) qr_solve(x, k);
    else with_width(k, [&](auto width) { lu_solve(x, width); });
  }

  // The least-norm solution x (rows) of Aᵀ x = y (n).
  void solve_transposed(const double* y, double* x) const { rows == n ? lu_transposed(y, x) : qr_transposed(y, x); }

 private:
  void judge(double low, double high) { ratio = n ? (low > 0 && std::isfinite(high) ? low / high : 0) : 1; }
  double* row(int r) const { return a + size_t(r) * n; }
  bool is_last(const Block& b) const { return b.first == pattern->shared; }

  // f(block, unknown, its rows from the pivot's on, how many they are), one elimination after the other.
  template <class F> void for_steps(F&& f) const {
    for (const Block& b : pattern->blocks)
      for (int c = b.first; c < b.end; ++c) f(b, c, &b.rows[c - b.first], int(b.rows.size()) - (c - b.first));
  }
  template <class F> void for_steps_back(F&& f) const {
    for (auto b = pattern->blocks.rbegin(); b != pattern->blocks.rend(); ++b)
      for (int c = b->end - 1; c >= b->first; --c) f(*b, c, &b->rows[c - b->first], int(b->rows.size()) - (c - b->first));
  }
  // f(k) for the unknowns of a block from k on, and those shared.
  template <class F> void for_columns(const Block& b, int k, F&& f) const {
    for (; k < b.end; ++k) f(k);
    if (!is_last(b))
      for (k = pattern->shared; k < n; ++k) f(k);
  }
  // f(row of the pivot, unknown) for the unknowns eliminated before c that its column was a part of.
  template <class F> void for_earlier(const Block& b, int c, F&& f) const {
    for (int k = is_last(b) ? 0 : b.first; k < c; ++k) f(pattern->slots[k], k);
  }

  void lu() {
    sign = 1;
    double low = INFINITY, high = 0;
    bool whole = true;
    for_steps([&](const Block& b, int c, const int* left, int count) {
      if (!whole) return;
      int best = 0;
      for (int r = 1; r < count; ++r)
        if (std::abs(row(left[r])[c]) > std::abs(row(left[best])[c])) best = r;
      double *top = row(left[0]), *chosen = row(left[best]);
      pivot[c] = left[best];
      if (best) {
        sign = -sign;
        for_columns(b, c, [&](int k) { std::swap(top[k], chosen[k]); });  // what was eliminated stays in its row
      }
      const double p = top[c];
      if (!(std::abs(p) > 0)) {
        whole = false;
        return;
      }
      low = std::min(low, std::abs(p)), high = std::max(high, std::abs(p));
      if (p < 0) sign = -sign;
      const double inverse = 1 / p;
      for (int r = 1; r < count; ++r) {
        double* x = row(left[r]);
        const double f = x[c] *= inverse;
        if (f != 0) for_columns(b, c + 1, [&](int k) { x[k] -= f * top[k]; });
      }
    });
    whole ? judge(low, high) : judge(0, 1);
  }
  template <class K> void lu_solve(double* x, K k) const {
    for_steps([&](const Block&, int c, const int* left, int count) {
      if (pivot[c] != left[0]) std::swap_ranges(x + pivot[c] * k, x + pivot[c] * k + k, x + left[0] * k);
      for (int r = 1; r < count; ++r) subtract(x + left[r] * k, row(left[r])[c], x + left[0] * k, k);
    });
    for_steps_back([&](const Block& b, int c, const int* left, int) {
      double* y = x + left[0] * k;
      const double inverse = 1 / row(left[0])[c];
      for (int i = 0; i < k; ++i) y[i] *= inverse;
      for_earlier(b, c, [&](int r, int) { subtract(x + r * k, row(r)[c], y, k); });
    });
  }
  template <class K> static void subtract(double* x, double f, const double* y, K k) {  // x −= f y
    if (f != 0)
      for (int i = 0; i < k; ++i) x[i] -= f * y[i];
  }
  void lu_transposed(const double* y, double* x) const {
    for_steps([&](const Block& b, int c, const int* left, int) {
      double s = y[c];
      for_earlier(b, c, [&](int r, int) { s -= row(r)[c] * x[r]; });
      x[left[0]] = s / row(left[0])[c];
    });
    for_steps_back([&](const Block&, int c, const int* left, int count) {
      for (int r = 1; r < count; ++r) x[left[0]] -= row(left[r])[c] * x[left[r]];
      std::swap(x[left[0]], x[pivot[c]]);
    });
  }

  void qr() {
    double low = INFINITY, high = 0;
    bool whole = true;
    for_steps([&](const Block& b, int c, const int* left, int count) {
      if (!whole) return;
      double norm = 0;
      for (int r = 0; r < count; ++r) norm += row(left[r])[c] * row(left[r])[c];
      norm = std::sqrt(norm);
      if (!(norm > 0)) {
        whole = false;
        return;
      }
      low = std::min(low, norm), high = std::max(high, norm);
      const double head = row(left[0])[c], d = head > 0 ? -norm : norm;
      diagonal[c] = d;
      row(left[0])[c] = head - d;  // the reflector v stays in the column, vᵀv = −2 d (head − d)
      for_columns(b, c + 1, [&](int k) { reflect(a + k, n, c, left, count); });
    });
    whole ? judge(low, high) : judge(0, 1);
  }
  // One column x of a matrix (with a stride) mirrored in the reflector of unknown c.
  void reflect(double* x, int stride, int c, const int* left, int count) const {
    double s = 0;
    for (int r = 0; r < count; ++r) s += row(left[r])[c] * x[left[r] * stride];
    s *= -1 / (diagonal[c] * row(left[0])[c]);
    for (int r = 0; r < count; ++r) x[left[r] * stride] -= s * row(left[r])[c];
  }
  void qr_solve(double* x, int k) const {
    for_steps([&](const Block&, int c, const int* left, int count) {
      for (int i = 0; i < k; ++i) reflect(x + i, k, c, left, count);
    });
    for_steps_back([&](const Block& b, int c, const int* left, int) {
      double* y = x + left[0] * k;
      for (int i = 0; i < k; ++i) y[i] /= diagonal[c];
      for_earlier(b, c, [&](int r, int) { subtract(x + r * k, row(r)[c], y, k); });
    });
  }
  void qr_transposed(const double* y, double* x) const {
    std::fill(x, x + rows, 0.);
    for_steps([&](const Block& b, int c, const int* left, int) {
      double s = y[c];
      for_earlier(b, c, [&](int r, int) { s -= row(r)[c] * x[r]; });
      x[left[0]] = s / diagonal[c];
    });
    for_steps_back([&](const Block&, int c, const int* left, int count) { reflect(x, 1, c, left, count); });
  }
};

// Cholesky of a symmetric positive definite n × n matrix (its lower triangle), in place; false where it is not.
inline bool cholesky(double* a, int n) {
  for (int c = 0; c < n; ++c) {
    double d = a[c * n + c];
    for (int k = 0; k < c; ++k) d -= a[c * n + k] * a[c * n + k];
    if (!(d > 0)) return false;
    d = std::sqrt(d);
    a[c * n + c] = d;
    for (int r = c + 1; r < n; ++r) {
      double s = a[r * n + c];
      for (int k = 0; k < c; ++k) s -= a[r * n + k] * a[c * n + k];
      a[r * n + c] = s / d;
    }
  }
  return true;
}
inline void cholesky_solve(const double* l, int n, double* x, int k) {
  for (int c = 0; c < n; ++c) {
    for (int j = 0; j < c; ++j)
      for (int i = 0; i < k; ++i) x[c * k + i] -= l[c * n + j] * x[j * k + i];
    for (int i = 0; i < k; ++i) x[c * k + i] /= l[c * n + c];
  }
  for (int c = n - 1; c >= 0; --c) {
    for (int j = c + 1; j < n; ++j)
      for (int i = 0; i < k; ++i) x[c * k + i] -= l[j * n + c] * x[j * k + i];
    for (int i = 0; i < k; ++i) x[c * k + i] /= l[c * n + c];
  }
}

}  // namespace ccpin
