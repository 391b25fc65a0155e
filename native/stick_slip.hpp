// Forward dynamics with dry friction, as ccpin.simulation.plant.stick_slip has it, which is the definition of all that is
// decided here: a joint slides in a known direction, under −[c + (s − c) exp(−(q̇′_j/v_s)²)] sign(q̇′_j) − b q̇′_j, or rests,
// q̈′_j = 0, with a multiplier |f_j| ≤ s. Which of the joints that have halted stay at rest, and which way the others start to slide, is told by
//
//   q̈ = argmin ½(q̈ − a)ᵀD(q̈ − a) + Σ s_j |q̈′_j|,   q̈′_j = ρ_j q̈ + (ρ̇ q̇)_j,
//
// whose dual is a least-squares problem in f/s within ±1 (Stark and Parker, Bounded-variable least-squares, Comput. Stat.
// 10, 1995; step for step as scipy.optimize.lsq_linear's).
#pragma once
#include "workspace.hpp"

#include <Eigen/Eigenvalues>
#include <Eigen/SVD>

namespace ccpin {

using MatX = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using VecX = Eigen::VectorXd;

// x of least norm among those with least ‖A x − b‖; singular values below `cut` of the largest are none.
inline VecX least_norm(const MatX& A, const VecX& b, double cut) {
  Eigen::JacobiSVD<MatX> svd(A, Eigen::ComputeThinU | Eigen::ComputeThinV);
  svd.setThreshold(cut);
  return svd.solve(b);
}
inline double rounding(const MatX& A) {
  return std::numeric_limits<double>::epsilon() * double(std::max(A.rows(), A.cols()));
}

// argmin ‖A x − b‖² over |x| ≤ 1; false where it was not found.
class BoundedLeastSquares {
 public:
  VecX x;

  BoundedLeastSquares(const MatX& A, const VecX& b) : A_(A), b_(b) {}

  bool solve() {
    x = least_norm(A_, b_, std::numeric_limits<double>::epsilon());
    if ((x.array().abs() <= 1).all()) return true;
    side_.assign(x.size(), 0);
    for (Eigen::Index i = 0; i < x.size(); ++i) hold(i, x[i] <= -1 ? -1 : x[i] >= 1 ? 1 : 0);
    while (free()) {  // the first x: bounds where the free ones' least squares are beyond them
      const VecX z = free_solution();
      bool beyond = false;
      for (size_t k = 0; k < free_.size(); ++k) {
        hold(free_[k], z[k] < -1 ? -1 : z[k] > 1 ? 1 : 0);
        if (side_[free_[k]]) beyond = true;
        else x[free_[k]] = z[k];
      }
      if (!beyond) break;
    }
    look();
    for (int round = 0; round < kRounds; ++round) {
      if (violation_ < kTolerance) return true;
      side_[worst_] = 0;
      while (approach()) {}
      const double before = cost_;
      look();
      if (before - cost_ < kTolerance * before) return true;
    }
    return violation_ < kTolerance;
  }

 private:
  static constexpr double kTolerance = 1e-13;
  static constexpr int kRounds = 100;
  const MatX& A_;
  const VecX& b_;
  std::vector<int> side_;  // −1, 1: at that bound
  std::vector<Eigen::Index> free_;
  double cost_ = 0, violation_ = 0;
  Eigen::Index worst_ = 0;

  void hold(Eigen::Index i, int side) {
    side_[i] = side;
    if (side) x[i] = side;
  }
  bool free() {
    free_.clear();
    for (Eigen::Index i = 0; i < x.size(); ++i)
      if (!side_[i]) free_.push_back(i);
    return !free_.empty();
  }
  // The free ones' least squares, the others held.
  VecX free_solution() const {
    MatX some(A_.rows(), free_.size());
    VecX held = x;
    for (size_t k = 0; k < free_.size(); ++k) some.col(k) = A_.col(free_[k]), held[free_[k]] = 0;
    return least_norm(some, b_ - A_ * held, rounding(some));
  }
  // Towards it, up to the first bound; whether there is one.
  bool approach() {
    if (!free()) return false;
    const VecX z = free_solution();
    double part = INFINITY;
    Eigen::Index first = -1;
    for (const int side : {-1, 1})
      for (size_t k = 0; k < free_.size(); ++k) {
        const double at = x[free_[k]];
        if (!(z[k] * side > 1) || !((side - at) / (z[k] - at) < part)) continue;
        part = (side - at) / (z[k] - at), first = Eigen::Index(k);
      }
    for (size_t k = 0; k < free_.size(); ++k) x[free_[k]] = first < 0 ? z[k] : (1 - part) * x[free_[k]] + part * z[k];
    if (first < 0) return false;
    side_[free_[first]] = z[first] < 0 ? -1 : 1;
    return true;
  }
  void look() {
    const VecX residual = A_ * x - b_, g = A_.transpose() * residual;
    cost_ = 0.5 * residual.squaredNorm(), violation_ = -INFINITY;
    double most = -INFINITY;
    for (Eigen::Index i = 0; i < x.size(); ++i) {
      violation_ = std::max(violation_, side_[i] ? g[i] * side_[i] : std::abs(g[i]));
      if (g[i] * side_[i] > most) most = g[i] * side_[i], worst_ = i;
    }
  }
};

struct Rubbing {
  int component, coordinate;  // of q̇′; the independent velocity it is, −1: none
  double coulomb, viscous, breakaway, stribeck_speed;
  // c + (s − c) exp(−(q̇′/v_s)²)
  double level(double rate) const {
    if (breakaway == coulomb) return coulomb;
    const double x = rate / stribeck_speed;
    return coulomb + (breakaway - coulomb) * std::exp(-(x * x));
  }
};

// The joints that rub, and their mode: which way each slides (0: it rests, or is not dry), which rest, which have just
// halted, and whether nothing moves.
struct Friction {
  std::vector<Rubbing> joints;
  std::vector<double> signs;
  std::vector<int> rest, halted;
  bool locked = false;
};

// All of it at the configuration that the model is closed at.
class StickSlip {
 public:
  Friction mode;

  StickSlip(Workspace& w, const Friction& friction) : mode(friction), w_(w), m_(w.model.m) {
    const Eigen::Index k = Eigen::Index(mode.joints.size());
    rows_ = MatX::Zero(k, m_.n), rates_.resize(k), force_.resize(k), a_.resize(m_.n), load_.resize(m_.n);
    std::vector<int> cluster(m_.nv);
    for (size_t j = 1; j < m_.joints.size(); ++j)
      for (int s = 0; s < m_.joints[j].nv; ++s) cluster[m_.joints[j].v + s] = m_.cluster_of[j];
    for (const Rubbing& joint : mode.joints) {
      cluster_.push_back(cluster[joint.component]);
      eventful_ |= joint.breakaway > 0;
    }
    D_.resize(m_.n, m_.n), C_ = D_, rho_.resize(m_.nv, m_.n), rho_dot_ = rho_;
  }
  bool eventful() const { return eventful_; }

  // Decides which joints rest and which way the others slide, from q̇, the load and who has just halted; q̇ is then brought to
  // rest. False, and all as it was, where that was not found.
  bool begin(double* v, const double* u, const Pushes& pushes) {
    const Friction before = mode;
    held_q_.clear();
    move(v);
    for (Eigen::Index k = 0; k < rates_.size(); ++k) {
      const bool dry = mode.joints[k].breakaway > 0;
      mode.rest[k] |= mode.halted[k] | (dry && std::abs(rates_[k]) <= kRest);
      mode.signs[k] = dry && !mode.rest[k] ? sign(rates_[k]) : 0;
    }
    std::fill(mode.halted.begin(), mode.halted.end(), 0), mode.locked = false;
    gather();
    if (resting_.empty()) return true;
    VecX slowed = Eigen::Map<VecX>(v, m_.n), starts, force;
    if (slowed.any()) bring_to_rest(slowed);
    if (!know(slowed.data(), u, pushes) || !at_rest(starts, force)) return mode = before, false;
    for (size_t r = 0; r < resting_.size(); ++r) mode.signs[resting_[r]] = starts[r], mode.rest[resting_[r]] = starts[r] == 0;
    gather();
    mode.locked = !resting_.empty() && fixed();
    return Eigen::Map<VecX>(v, m_.n) = slowed, true;
  }

  // q̈ in the present mode, whose resting joints are pulled back to rest where integration leaves them a rate.
  bool acceleration(const double* v, const double* u, double* a, const Pushes& pushes) {
    if (mode.locked) return std::fill(a, a + m_.n, 0.), true;
    gather();
    return know(v, u, pushes) && answer(a);
  }

  // The same, and f of every component of q̇′, added.
  bool sample(const double* v, const double* u, double* a, double* forces, const Pushes& pushes) {
    gather();
    VecX starts, force;
    if (mode.locked && still_held(v, u)) slide(v), force = held_force_;
    else if (!know(v, u, pushes) || (!resting_.empty() && !at_rest(starts, force))) return false;
    else hold(v, u, force, !starts.any());
    if (mode.locked) std::fill(a, a + m_.n, 0.);
    else if (!answer(a)) return false;
    for (size_t r = 0; r < resting_.size(); ++r) force_[resting_[r]] += force[r];
    for (Eigen::Index k = 0; k < force_.size(); ++k) forces[mode.joints[k].component] += force_[k];
    return true;
  }

  // Whether a sliding joint has turned back (then `turned` says which), or a resting one is overloaded; false: no answer.
  bool broken(const double* v, const double* u, const Pushes& pushes, bool& found) {
    move(v);
    turned.assign(mode.joints.size(), 0), found = false, margin = INFINITY;
    for (size_t k = 0; k < turned.size(); ++k)
      if (mode.signs[k] != 0) {
        const double left = mode.signs[k] * rates_[k] + kReversed;
        found |= (turned[k] = left < 0), margin = std::min(margin, left);
      }
    gather();
    if (found || resting_.empty() || still_held(v, u)) return true;
    VecX starts, force;
    if (!know(v, u, pushes) || !at_rest(starts, force)) return false;
    found = starts.any();
    hold(v, u, force, !found);
    return true;
  }
  std::vector<int> turned;
  double margin = 0;  // what the slowest of those that slide has left of its rate, negative where it has turned back

 private:
  static constexpr double kRest = 1e-8, kReversed = 1e-14, kWithin = 1e-8, kReleased = 1e-9, kPull = 50, kIndependent = 1e-2,
                          kNil = 1e-6, kFirm = 1e-6, kNone = 1e-13, kThere = 1e-4;
  Workspace& w_;
  const Mechanism& m_;
  bool eventful_ = false;
  std::vector<int> cluster_;   // by rubbing joint
  std::vector<int> resting_;   // those at rest
  std::vector<double> held_q_, held_u_;  // where, and under which u, joints stayed at rest, nothing moving,
  VecX held_force_;                      // and their forces there
  MatX rows_, D_, C_, rho_, rho_dot_;    // ρ's rows of the rubbing joints; D, then its Cholesky factor
  VecX rates_, force_, a_, load_;        // their rates and known forces; q̈ and the load under these
  MatX resting_rows_, reach_;            // ρ_r and L⁻¹ρ_rᵀ (D = L Lᵀ) of those at rest
  enum class Shares { unknown, unique, least } known_ = Shares::unknown;
  MatX compliance_, along_;              // the factor of ρ_r D⁻¹ρ_rᵀ where shares are unique, V or V S where not,
  VecX softness_;                        // and S⁻² or S⁻⁴
  MatX squared_;                         // L⁻¹ρ_rᵀρ_r L⁻ᵀ
  Eigen::SelfAdjointEigenSolver<MatX> spectrum_;
  VecX bias_;                            // (ρ̇ q̇)_r

  static double sign(double x) { return x > 0 ? 1 : x < 0 ? -1 : 0; }

  void gather() {
    resting_.clear();
    for (size_t k = 0; k < mode.rest.size(); ++k)
      if (mode.rest[k]) resting_.push_back(int(k));
  }
  static bool moves(const double* v, int n) {
    return std::any_of(v, v + n, [](double x) { return x != 0; });
  }
  bool still_held(const double* v, const double* u) const {
    return w_.model.q_free == held_q_ && !moves(v, m_.n) && std::equal(held_u_.begin(), held_u_.end(), u);
  }
  void hold(const double* v, const double* u, const VecX& force, bool stays) {
    held_q_.clear();
    if (stays && !moves(v, m_.n)) held_q_ = w_.model.q_free, held_u_.assign(u, u + m_.motors), held_force_ = force;
  }
  MatX rows_at_rest() const {
    MatX rows(resting_.size(), m_.n);
    for (size_t r = 0; r < resting_.size(); ++r) rows.row(r) = rows_.row(resting_[r]);
    return rows;
  }

  // ρ's rows and the rates.
  void move(const double* v) {
    for (size_t k = 0; k < mode.joints.size(); ++k) {
      const Rubbing& joint = mode.joints[k];
      const Cluster& c = m_.clusters[cluster_[k]];
      const double* rho = &w_.model.states[cluster_[k]].rho[size_t(m_.column_of[joint.component]) * c.n()];
      for (int i = 0; i < c.n(); ++i) rows_(k, c.independent[i]) = joint.coordinate < 0 ? rho[i] : 0;
      if (joint.coordinate >= 0) rows_(k, joint.coordinate) = 1;
    }
    rates_.noalias() = rows_ * Eigen::Map<const VecX>(v, m_.n);
  }

  // That, and the forces of joints that are not at rest.
  void slide(const double* v) {
    move(v);
    for (size_t k = 0; k < mode.joints.size(); ++k)
      force_[k] = -mode.joints[k].viscous * rates_[k] - mode.joints[k].level(rates_[k]) * mode.signs[k];
  }

  // The dynamics under every force that is known: all but that of the joints at rest. False: there are none.
  bool know(const double* v, const double* u, const Pushes& pushes) {
    slide(v);
    load_.noalias() = rows_.transpose() * force_;
    if (!w_.model.forward(v, u, a_.data(), pushes, load_.data())) return false;
    if (resting_.empty()) return true;
    if (!a_.allFinite()) return false;
    resting_rows_ = rows_at_rest(), bias_.resize(resting_.size());
    for (size_t r = 0; r < resting_.size(); ++r) {
      const Rubbing& joint = mode.joints[resting_[r]];
      const ClusterState& s = w_.model.states[cluster_[resting_[r]]];
      bias_[r] = joint.coordinate < 0 ? s.bias[m_.column_of[joint.component]] : 0;
      if (resting_rows_.row(r).norm() <= kNil) resting_rows_.row(r).setZero();  // what vanishes holds nothing
    }
    if (!w_.model.mass(D_.data())) w_.terms.matrices(v, D_.data(), C_.data(), rho_.data(), rho_dot_.data());
    if (!cholesky(D_.data(), m_.n)) return false;
    reach_ = D_.triangularView<Eigen::Lower>().solve(resting_rows_.transpose());
    known_ = Shares::unknown;
    return true;
  }

  // q̈ under the resting joints' forces too.
  bool answer(double* a) {
    Eigen::Map<VecX> out(a, m_.n);
    out = a_;
    if (resting_.empty()) return true;
    VecX target = -bias_;
    for (size_t r = 0; r < resting_.size(); ++r) target[r] -= kPull * rates_[resting_[r]];
    out += gained(multipliers(target));
    for (const int k : resting_)
      if (mode.joints[k].coordinate >= 0) a[mode.joints[k].coordinate] = 0;
    return true;
  }

  // D⁻¹ρ_rᵀf.
  VecX gained(const VecX& force) const { return D_.transpose().triangularView<Eigen::Upper>().solve(reach_ * force); }

  // f of least norm with ρ_r(a + D⁻¹ρ_rᵀf) = target; by Cholesky where only one f does it, beyond doubt.
  VecX multipliers(const VecX& target) {
    VecX missing = target - resting_rows_ * a_;
    if (known_ == Shares::unknown) find_shares();
    if (known_ == Shares::unique) cholesky_solve(compliance_.data(), int(missing.size()), missing.data(), 1);
    else missing = along_ * (along_.transpose() * missing).cwiseProduct(softness_);
    return missing;
  }
  // With B = L⁻¹ρ_rᵀ = U S Vᵀ that is f = V S⁻² Vᵀ(…), of which what S² has below 1e-12 of its largest is none. Of more
  // joints than freedoms B Bᵀ = U S² Uᵀ is small, and tells V = Bᵀ U S⁻¹ where each of S² is there or none beyond doubt.
  void find_shares() {
    const Eigen::Index size = reach_.cols();
    if (size <= m_.n) {
      compliance_.noalias() = reach_.transpose() * reach_;
      if (cholesky(compliance_.data(), int(size))) {
        const auto pivots = compliance_.diagonal();
        if (pivots.minCoeff() > kIndependent * pivots.maxCoeff()) return void(known_ = Shares::unique);
      }
    }
    known_ = Shares::least;
    softness_ = VecX::Zero(m_.n), squared_.noalias() = reach_ * reach_.transpose(), spectrum_.compute(squared_);
    const VecX& squares = spectrum_.eigenvalues();
    const double largest = squares[m_.n - 1];
    bool doubtful = spectrum_.info() != Eigen::Success;
    for (const double x : squares) doubtful |= x > kNone * largest && x < kThere * largest;
    if (!doubtful) {
      along_.noalias() = reach_.transpose() * spectrum_.eigenvectors();
      for (int i = 0; i < m_.n; ++i)
        if (squares[i] > kNone * largest) softness_[i] = 1 / (squares[i] * squares[i]);
      return;
    }
    const Eigen::JacobiSVD<MatX> svd(reach_, Eigen::ComputeThinV);
    const VecX& sizes = svd.singularValues();
    along_ = svd.matrixV(), softness_ = VecX::Zero(sizes.size());
    for (Eigen::Index i = 0; i < sizes.size(); ++i)
      if (sizes[i] > kFirm * sizes[0]) softness_[i] = 1 / (sizes[i] * sizes[i]);
  }

  // Which way each resting joint starts to slide (0: it stays), and its force; false: not found.
  bool at_rest(VecX& starts, VecX& force) {
    starts = VecX::Zero(resting_.size());
    force = multipliers(-bias_);
    VecX level(resting_.size());
    for (size_t r = 0; r < resting_.size(); ++r) level[r] = mode.joints[resting_[r]].breakaway;
    const VecX pushed = resting_rows_ * a_ + bias_;
    const double least = kReleased * std::max(pushed.array().abs().maxCoeff(), a_.array().abs().maxCoeff());
    bool held = (force.array().abs() <= level.array() * (1 + kWithin)).all();
    for (Eigen::Index r = 0; r < pushed.size(); ++r) held &= std::abs(pushed[r]) <= least || resting_rows_.row(r).any();
    if (held) return true;
    if (level.size() == 1) force[0] = std::min(std::max(force[0], -level[0]), level[0]);
    else if (!least_constraint(level, force)) return false;
    const VecX a = pushed + resting_rows_ * gained(force);
    for (Eigen::Index r = 0; r < a.size(); ++r) starts[r] = std::abs(a[r]) > least ? sign(a[r]) : 0;
    return true;
  }

  // argmin over |f| ≤ s of ½‖Lᵀ(a + d) + L⁻¹ρ_rᵀf‖², ρ_r d = (ρ̇ q̇)_r, D = L Lᵀ.
  bool least_constraint(const VecX& level, VecX& force) const {
    VecX d = a_;
    if (bias_.any()) d += with_rates(resting_rows_, bias_);
    MatX matrix = reach_ * level.asDiagonal();
    VecX right = -(D_.transpose().triangularView<Eigen::Upper>() * d);
    const double scale = right.norm();
    matrix /= scale, right /= scale;
    BoundedLeastSquares problem(matrix, right);
    if (!matrix.allFinite() || !right.allFinite() || !problem.solve()) return false;
    return force = problem.x.cwiseProduct(level), true;
  }

  // Whether nothing moves while these joints rest.
  bool fixed() const {
    if (int(resting_.size()) < m_.n) return false;
    const Eigen::JacobiSVD<MatX> svd(rows_at_rest());
    return svd.singularValues()[m_.n - 1] > kNil;
  }

  // q̇ of least norm with these rates, where rows that vanish, or depend on others, move nothing.
  static VecX with_rates(const MatX& rows, const VecX& rates) {
    const Eigen::JacobiSVD<MatX> svd(rows, Eigen::ComputeThinU | Eigen::ComputeThinV);
    VecX along = svd.matrixU().transpose() * rates;
    const VecX& sizes = svd.singularValues();
    for (Eigen::Index i = 0; i < sizes.size(); ++i) along[i] = sizes[i] > kNil ? along[i] / sizes[i] : 0;
    return svd.matrixV() * along;
  }

  // q̇ with the resting joints' rates removed, exactly where they are independent coordinates.
  void bring_to_rest(VecX& v) const {
    if (fixed()) return void(v.setZero());
    const MatX rows = rows_at_rest();
    v -= with_rates(rows, rows * v);
    for (const int k : resting_)
      if (mode.joints[k].coordinate >= 0) v[mode.joints[k].coordinate] = 0;
  }
};

}  // namespace ccpin
