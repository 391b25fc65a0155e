// One box: a search for R, w and κ with which Theorem N holds, and its strict check. The theorem, its proof and the
// search are those of `covering/proposals/krawczyk.py`, step for step.
#pragma once
#include "bounds_planar.hpp"
#include "bounds_reach.hpp"
#include "linear.hpp"

#include <Eigen/Eigenvalues>

namespace ccpin::certificates {

constexpr double kSlack = 1 + 1e-10;

// Solves many systems of m equations; false where one is singular.
class Solver {
 public:
  explicit Solver(int m) : m_(m), a_(size_t(m) * m), pivot_(m), pattern_(dense(m, m)) {}
  Solver(const Solver&) = delete;

  bool factorize(const double* matrix) {
    std::copy_n(matrix, a_.size(), a_.data());
    factor_.factorize();
    return factor_.ratio > 0;
  }
  bool factorize_defect(const Doubles& columns) {  // I − a matrix kept by columns
    for (int k = 0; k < m_; ++k)
      for (int i = 0; i < m_; ++i) a_[i * m_ + k] = (i == k) - columns[k * m_ + i];
    factor_.factorize();
    return factor_.ratio > 0;
  }
  void solve(double* x, int columns = 1) const { factor_.solve(x, columns); }

 private:
  int m_;
  Doubles a_;
  std::vector<int> pivot_;
  Pattern pattern_;
  Factor factor_{&pattern_, a_.data(), pivot_.data(), nullptr, m_, m_};
};

class Krawczyk {
 public:
  explicit Krawczyk(const Closures& c) : c_(c), solver_(c.m) {
    if (c.planar)
      bounds_ = std::make_unique<PlanarBounds>(c);
    else
      bounds_ = std::make_unique<ReachBounds>(c);
  }

  // Tries to prove a box about θ_c with V = I and, where that fails, singular vectors (`certify_boxes`); `across` (n, p)
  // holds the independent rows of D.
  bool certify(const double* centre, const double* half, int p, const double* across, Box& box) {
    c_.evaluate(centre, at_);
    if (!parametrize(centre, half, p, across, box)) return false;
    if (attempt(box, true)) return true;
    find_gram();
    if (c_.m == 1 || !one_weak()) return false;
    turn_to_singular_vectors(box);
    if (attempt(box, true)) return true;
    turn_back(box);
    return false;
  }

  // A box with p = 0 that encloses a solution at fixed q (`certify_points`).
  bool certify_point(const double* theta, Box& box) {
    c_.evaluate(theta, at_);
    if (!parametrize(theta, nullptr, 0, nullptr, box)) return false;
    find_gram(), turn_to_singular_vectors(box);
    return attempt(box, false);
  }

  // Y, Z̄(R)R and Z(R)w of a box as it is.
  void bounds(const Box& box, double* y, double* image, double* shrunk) {
    c_.evaluate(box.centre.data(), at_);
    bounds_->set(box, at_);
    std::copy(bounds_->y.begin(), bounds_->y.end(), y);
    bounds_->mean(box.radius, image_), image_.of(box.radius.data(), solved_);
    std::copy_n(solved_.data(), c_.m, image);
    bounds_->contraction(box.radius, box.weight, image_), image_.of(box.weight.data(), solved_);
    std::copy_n(solved_.data(), c_.m, shrunk);
  }

 private:
  using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  const Closures& c_;
  std::unique_ptr<Bounds> bounds_;
  Values at_;
  Solver solver_;
  Image image_;
  Matrix gram_;
  Doubles inverse_, trial_, step_, last_, solved_, shrunk_;

  // D, V = I and Ã from φ_θ at the centre; false where φ_y has no inverse.
  bool parametrize(const double* centre, const double* half, int p, const double* across, Box& box) {
    const int m = c_.m, n_free = c_.n_free;
    box.centre.assign(centre, centre + n_free), box.half.assign(half, half + p);
    box.directions.assign(size_t(n_free) * p, 0.);
    if (!invert()) {
      box.modes.assign(size_t(m) * m, NAN), box.preconditioner = box.modes;
      return false;
    }
    for (int k = 0; k < c_.n; ++k) std::copy_n(across + k * p, p, box.directions.data() + c_.independent[k] * p);
    Doubles slope(size_t(m) * p, 0.);
    for (int r = 0; r < m; ++r)
      for (int k = 0; k < c_.n; ++k)
        add_scaled(slope.data() + r * p, at_.jacobian[r * n_free + c_.independent[k]], across + k * p, p);
    for (int k = 0; k < m; ++k)
      for (int r = 0; r < m; ++r)
        add_scaled(box.directions.data() + c_.dependent[k] * p, -inverse_[k * m + r], slope.data() + r * p, p);
    turn_back(box);
    return true;
  }

  // V = I, Ã = φ_y⁻¹.
  void turn_back(Box& box) const {
    const int m = c_.m;
    box.plain = true, box.modes.assign(size_t(m) * m, 0.), box.preconditioner = inverse_;
    for (int k = 0; k < m; ++k) box.modes[k * m + k] = 1;
  }

  bool invert() {  // φ_y⁻¹
    const int m = c_.m;
    Doubles& matrix = solved_;
    matrix.resize(size_t(m) * m);
    for (int r = 0; r < m; ++r)
      for (int k = 0; k < m; ++k) matrix[r * m + k] = at_.jacobian[r * c_.n_free + c_.dependent[k]];
    if (!solver_.factorize(matrix.data())) return false;
    inverse_.assign(size_t(m) * m, 0.);
    for (int k = 0; k < m; ++k) inverse_[k * m + k] = 1;
    solver_.solve(inverse_.data(), m);
    return true;
  }

  // φ_y⁻¹φ_y⁻ᵀ: its eigenvalues are 1/σ² for the singular values σ of φ_y.
  void find_gram() {
    const Eigen::Map<const Matrix> A(inverse_.data(), c_.m, c_.m);
    gram_.noalias() = A * A.transpose();
  }

  // Whether one singular value of φ_y is well below all others (`_one_weak`).
  bool one_weak() const { return gram_.squaredNorm() >= 0.6 * gram_.trace() * gram_.trace(); }

  // V: the right singular vectors of φ_y; Ã = Vᵀφ_y⁻¹.
  void turn_to_singular_vectors(Box& box) {
    const int m = c_.m;
    box.plain = false;
    if (!gram_.allFinite()) return;
    const Matrix V = Eigen::SelfAdjointEigenSolver<Matrix>(gram_).eigenvectors();
    Eigen::Map<Matrix>(box.modes.data(), m, m) = V;
    const Eigen::Map<const Matrix> inverse(inverse_.data(), m, m);
    Eigen::Map<Matrix>(box.preconditioner.data(), m, m).noalias() = V.transpose() * inverse;
  }

  // Finds R and w, then checks strictly; a `roomy` R is well above rounding, so that boxes can be glued.
  bool attempt(Box& box, bool roomy) {
    const int m = c_.m;
    bounds_->set(box, at_);
    if (!find_radius(box.radius)) return false;
    if (roomy) {
      const double rounding = c_.gamma * c_.magnitude(box.centre.data());
      for (int i = 0; i < m; ++i) {
        double gain = 0;
        for (int k = 0; k < m; ++k) gain += std::abs(box.preconditioner[i * m + k]);
        box.radius[i] = std::max({box.radius[i] + rounding * gain, 1e-11, 16 * rounding * gain});
      }
    }
    return find_weight(box) && holds(box);
  }

  // (N1) from scratch; (N2) holds for the w and κ of `find_weight` by their making.
  bool holds(const Box& box) {
    bounds_->mean(box.radius, image_), image_.of(box.radius.data(), solved_);
    for (int i = 0; i < c_.m; ++i)
      if (!((bounds_->y[i] + solved_[i]) * kSlack < box.radius[i])) return false;
    return true;
  }

  // An R with Y + Z̄(R)R < R, near the least (`_radius`).
  bool find_radius(Doubles& found) {
    constexpr double inflation = 1e-4, settled = 1 + 1e-6, largest = 1e6;
    const int m = c_.m;
    const Doubles& y = bounds_->y;
    found = step_ = y, trial_.resize(m), solved_.resize(m);
    for (int i = 0; i < m; ++i) trial_[i] = y[i] * (1 + inflation);
    if (!std::all_of(y.begin(), y.end(), [](double x) { return std::isfinite(x); })) return false;
    for (int round = 0; round < 30; ++round) {
      bounds_->mean(trial_, image_), image_.of(trial_.data(), shrunk_);
      bool inside = true;
      for (int i = 0; i < m; ++i) inside = inside && (y[i] + shrunk_[i]) * settled < trial_[i];
      const bool alive = (inside || round % 2 == 0) && solve_mean(largest);
      if (inside && alive) {
        for (int i = 0; i < m; ++i) found[i] = solved_[i] + 0.1 * (trial_[i] - solved_[i]);
        return true;
      }
      if (round % 2) {
        trial_ = found;
        continue;
      }
      if (!alive) return false;
      last_ = step_, found = solved_;
      double rate = 0;
      bool growing = round > 0;
      for (int i = 0; i < m; ++i) {
        step_[i] = std::max(solved_[i] - trial_[i], 0.);
        rate = std::max(rate, step_[i] / std::max(last_[i], 1e-300)), growing = growing && step_[i] >= last_[i];
      }
      if (growing) return false;
      rate = std::min(rate, 0.98);
      for (int i = 0; i < m; ++i)
        trial_[i] = found[i] + step_[i] * (rate / (1 - rate)) * 1.05 + inflation * found[i];
    }
    return false;
  }

  // `solved_` = (I − M)⁻¹(Y + t) for the image last computed; whether it is a radius at all.
  bool solve_mean(double largest) {
    for (int i = 0; i < c_.m; ++i) solved_[i] = bounds_->y[i] + image_.rest[i];
    if (!solver_.factorize_defect(image_.columns)) return false;
    solver_.solve(solved_.data());
    for (double x : solved_)
      if (!(x >= 0 && x < largest)) return false;
    return true;
  }

  // A w > 0 and a κ < 1 with Zw · kSlack ≤ κw, where the spectral radius allows it (`_weights`).
  bool find_weight(Box& box) {
    const int m = c_.m;
    Doubles& weight = box.weight;
    weight.assign(m, 1.);
    bounds_->contraction(box.radius, weight, image_);
    for (int i = 0; i < m; ++i) weight[i] += image_.rest[i];
    if (!solver_.factorize_defect(image_.columns)) return false;
    solver_.solve(weight.data());
    for (double& w : weight) w = std::abs(w);
    for (int power = 0; power < 8; ++power) {
      const double largest = *std::max_element(weight.begin(), weight.end());
      for (double& w : weight) w /= largest;
      bounds_->contraction(box.radius, weight, image_), image_.of(weight.data(), shrunk_);
      double ratio = 0;
      for (int i = 0; i < m; ++i) {
        if (!(weight[i] > 0 && std::isfinite(shrunk_[i]))) return false;
        ratio = std::max(ratio, shrunk_[i] / weight[i]);
      }
      box.kappa = ratio * kSlack * kSlack + 1e-9;  // room for another order of operations (`verify`)
      if (box.kappa < 1) return true;
      for (int i = 0; i < m; ++i) weight[i] = 0.5 * (weight[i] + shrunk_[i]);
    }
    return false;
  }
};

}  // namespace ccpin::certificates
