// Dense linear algebra for the few unknowns of one cluster: row-major, in place, no allocation.
#pragma once
#include <algorithm>
#include <cmath>

namespace ccpin {

// ψ_q′ restricted to a cluster's dependent columns: LU with partial pivoting where square, Householder QR where
// redundant rows make it tall (least squares).
struct Factor {
  double* a;           // rows × n, row-major
  int* pivot;          // n
  double* diagonal;    // n (tall only)
  int rows, n;
  int sign = 0;        // of the determinant; 0 where tall
  double ratio = 0;    // smallest over largest pivot, 0 where singular: a cheap first look at the conditioning

  void factorize() { rows == n ? lu() : qr(); }

  // x (rows × k, row-major) becomes the solution in its first n rows.
  void solve(double* x, int k) const { rows == n ? lu_solve(x, k) : qr_solve(x, k); }

  // The least-norm solution x (rows) of Aᵀ x = y (n).
  void solve_transposed(const double* y, double* x) const { rows == n ? lu_transposed(y, x) : qr_transposed(y, x); }

 private:
  void judge(double low, double high) { ratio = n ? (low > 0 && std::isfinite(high) ? low / high : 0) : 1; }

  void lu() {
    sign = 1;
    double low = INFINITY, high = 0;
    for (int c = 0; c < n; ++c) {
      int best = c;
      for (int r = c + 1; r < n; ++r)
        if (std::abs(a[r * n + c]) > std::abs(a[best * n + c])) best = r;
      pivot[c] = best;
      if (best != c) std::swap_ranges(a + best * n, a + best * n + n, a + c * n), sign = -sign;
      const double p = a[c * n + c];
      if (!(std::abs(p) > 0)) return judge(0, 1);
      low = std::min(low, std::abs(p)), high = std::max(high, std::abs(p));
      if (p < 0) sign = -sign;
      const double inverse = 1 / p;
      for (int r = c + 1; r < n; ++r) {
        const double f = a[r * n + c] *= inverse;
        if (f != 0)
          for (int k = c + 1; k < n; ++k) a[r * n + k] -= f * a[c * n + k];
      }
    }
    judge(low, high);
  }
  void lu_solve(double* x, int k) const {
    for (int c = 0; c < n; ++c)
      if (pivot[c] != c) std::swap_ranges(x + pivot[c] * k, x + pivot[c] * k + k, x + c * k);
    for (int c = 0; c < n; ++c)
      for (int r = c + 1; r < n; ++r) subtract(x + r * k, a[r * n + c], x + c * k, k);
    for (int c = n - 1; c >= 0; --c) {
      const double inverse = 1 / a[c * n + c];
      for (int i = 0; i < k; ++i) x[c * k + i] *= inverse;
      for (int r = 0; r < c; ++r) subtract(x + r * k, a[r * n + c], x + c * k, k);
    }
  }
  static void subtract(double* x, double f, const double* y, int k) {  // x −= f y
    if (f != 0)
      for (int i = 0; i < k; ++i) x[i] -= f * y[i];
  }
  void lu_transposed(const double* y, double* x) const {
    for (int c = 0; c < n; ++c) {
      double s = y[c];
      for (int r = 0; r < c; ++r) s -= a[r * n + c] * x[r];
      x[c] = s / a[c * n + c];
    }
    for (int c = n - 1; c >= 0; --c)
      for (int r = c + 1; r < n; ++r) x[c] -= a[r * n + c] * x[r];
    for (int c = n - 1; c >= 0; --c) std::swap(x[c], x[pivot[c]]);
  }

  void qr() {
    double low = INFINITY, high = 0;
    for (int c = 0; c < n; ++c) {
      double norm = 0;
      for (int r = c; r < rows; ++r) norm += a[r * n + c] * a[r * n + c];
      norm = std::sqrt(norm);
      if (!(norm > 0)) return judge(0, 1);
      low = std::min(low, norm), high = std::max(high, norm);
      const double head = a[c * n + c], d = head > 0 ? -norm : norm;
      diagonal[c] = d;
      a[c * n + c] = head - d;  // the reflector v stays in the column, vᵀv = −2 d (head − d)
      const double beta = -1 / (d * a[c * n + c]);
      for (int k = c + 1; k < n; ++k) {
        double s = 0;
        for (int r = c; r < rows; ++r) s += a[r * n + c] * a[r * n + k];
        s *= beta;
        for (int r = c; r < rows; ++r) a[r * n + k] -= s * a[r * n + c];
      }
    }
    judge(low, high);
  }
  void reflect(double* x, int k, int c) const {
    const double beta = -1 / (diagonal[c] * a[c * n + c]);
    for (int i = 0; i < k; ++i) {
      double s = 0;
      for (int r = c; r < rows; ++r) s += a[r * n + c] * x[r * k + i];
      s *= beta;
      for (int r = c; r < rows; ++r) x[r * k + i] -= s * a[r * n + c];
    }
  }
  void qr_solve(double* x, int k) const {
    for (int c = 0; c < n; ++c) reflect(x, k, c);
    for (int c = n - 1; c >= 0; --c) {
      for (int i = 0; i < k; ++i) x[c * k + i] /= diagonal[c];
      for (int r = 0; r < c; ++r) subtract(x + r * k, a[r * n + c], x + c * k, k);
    }
  }
  void qr_transposed(const double* y, double* x) const {
    std::fill(x, x + rows, 0.);
    for (int c = 0; c < n; ++c) {
      double s = y[c];
      for (int r = 0; r < c; ++r) s -= a[r * n + c] * x[r];
      x[c] = s / diagonal[c];
    }
    for (int c = n - 1; c >= 0; --c) reflect(x, 1, c);
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
