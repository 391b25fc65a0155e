// q′ = σ(q) (12), cluster by cluster; the trust test is that of ccpin.kinematics.parametrization.
//
// Clusters share no row and no column of ψ, so each is solved alone: a step that one cluster does not trust shortens the
// way of that cluster only, and the branch reached is the same.
#pragma once
#include "dead_ends.hpp"

namespace ccpin {

constexpr double kContraction = 0.125, kChord = 0.0625;
constexpr double kNearSingular = 0.25, kNarrow = 0.5;  // what estimates may use of these and `kTurn`; far from singular sets of `kTurn`
constexpr double kStill = 1e-3;  // of the inverse of ψ_q′ times the way since it was factorised
constexpr double kStraight = 1e-6;  // shorter first corrections than this need no second derivative
constexpr double kOpenStart = 1e-6, kSingularWithin = 1e-6;  // the latter: of q, as the reference has it
constexpr int kMaxNewton = 16;

// A closed point, as a start: its ρ spares Newton the first evaluation, and ∂²σ/∂q² the second where it was asked for.
struct ClosedPoint {
  std::vector<double> q_free;
  std::vector<std::vector<double>> rho, curvature, probe;  // by cluster
  std::vector<int> sign;
};

class Parametrization : public DeadEnds {
 public:
  explicit Parametrization(const Mechanism& mechanism) : DeadEnds(mechanism) {
    for (const Cluster& c : m.clusters) open_by_.resize(std::max(open_by_.size(), size_t(c.phi_rows())));
  }

  // σ(q) from a start; false where the trusted path does not lead there. With `rho` false: q′ alone.
  bool sigma(const double* q, const double* start, bool rho = true) {
    closed_ = false, wants_rho_ = rho;
    for (size_t k = 0; k < m.clusters.size(); ++k)
      if (!solve(m.clusters[k], states[k], q, start, nullptr)) return false;
    closed_ = rho;
    return true;
  }
  bool sigma(const double* q, const ClosedPoint& near, bool rho = true) {
    closed_ = false, wants_rho_ = rho;
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      before_ = near.probe[k];
      const Known known{near.rho[k].data(), near.curvature[k], near.sign[k]};
      if (!solve(m.clusters[k], states[k], q, near.q_free.data(), &known)) return false;
    }
    closed_ = rho;
    return true;
  }
  // How much of the way from a closed start to q leads next to the singular configuration where it ends, and q′ there
  // (`q_free`): after a σ that was refused, which is remembered. 1: not known to end at one, or so near to q that the last
  // steps decide whether q itself is called singular.
  double ends_at(const double* q, const double* start) {
    closed_ = false, wants_rho_ = false;
    double least = 1, from = 1, to = 1;
    size_t first = 0;
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      if (solve(m.clusters[k], states[k], q, start, nullptr)) continue;
      if (!dead_end_.is(m.clusters[k], q, start)) return 1;
      from = std::min({from, dead_end_.from, dead_end_.done}), to = std::min(to, dead_end_.to);
      if (dead_end_.done < least) least = dead_end_.done, first = k, ended_ = dead_end_.q_free;
    }
    double length = 0;
    for (const Cluster& c : m.clusters) set_line(c, q, start);
    for (double x : line_) length += x * x;
    length = std::sqrt(length);
    if (least == 1 || !((1 - to) * length > kSingularWithin || (1 - from) * length <= kSingularWithin)) return 1;
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      const Cluster& c = m.clusters[k];
      if (k == first) continue;
      set_line(c, q, start), target(c, q, least);
      const std::vector<double> there = q_ahead_;  // a walk has targets of its own
      if (!solve(c, states[k], there.data(), start, nullptr)) return 1;
    }
    copy_cluster(m.clusters[first], ended_.data(), q_free.data());
    return least;
  }
  // The closed point, after ρ was asked for; with ∂²σ/∂q², which pays where many q are asked for from it.
  void remember(ClosedPoint& point, bool curved = false) {
    point.q_free = q_free;
    const size_t clusters = states.size();
    point.rho.resize(clusters), point.curvature.resize(clusters), point.probe.resize(clusters), point.sign.resize(clusters);
    for (size_t k = 0; k < clusters; ++k) {
      solve_beside_probe(m.clusters[k], states[k], 2);
      point.rho[k] = states[k].rho, point.probe[k] = states[k].probe, point.sign[k] = states[k].factor.sign;
      point.curvature[k].clear();
      if (curved) curvature(m.clusters[k], states[k], point.curvature[k]);
    }
  }

  // ρ at a configuration that is closed already; false where it is singular. Asked again at the same one, bit for bit, or
  // where σ has just led, it is there: a State's questions all come with its q′.
  bool at(const double* q_closed) {
    if (closed_ && std::memcmp(q_closed, q_free.data(), sizeof(double) * m.nq) == 0) return true;
    closed_ = false;
    std::copy(q_closed, q_closed + m.nq, q_free.begin());
    for (size_t k = 0; k < m.clusters.size(); ++k) {
      linearize(m.clusters[k], states[k], nullptr);
      if (!finish(m.clusters[k], states[k])) return false;
    }
    return closed_ = true;
  }

 private:
  // Of a closed start, whose probe is `before_`; no curvature: not known.
  struct Known { const double* rho; const std::vector<double>& curvature; int sign; };
  std::vector<double> before_, ended_;
  std::vector<double> open_by_;  // −φ of an open start,
  double opening_ = 0;           // and how much of it shall be left
  bool wants_rho_ = true, factorized_ = false;  // the latter: whether Newton's last method has ended with ψ_q′ factorised
  std::vector<double> missing_, gap_;  // residual and gap of the start
  double shrank_ = 0;                  // the largest ratio of a correction to the one before

  bool solve(const Cluster& c, ClusterState& s, const double* q, const double* start, const Known* known) {
    bool open = false;
    if (newton(c, s, q, start, known, open)) return true;
    if (open && !close_start(c, s, start)) return false;
    return walk(c, s, q, open ? here_.data() : start);
  }

  // One trusted Newton solve on ψ̄ (11): its second correction is at most an eighth of the first, no step is longer than
  // one, det ψ_q′ keeps its sign, and ψ_q′⁻¹ B changes by a quarter of itself at most; near singular sets by a thirty-second and
  // an eighth, unless the step is proved. Where ρ at a closed start is known, the
  // first step is ρ Δq, and where ∂²σ/∂q² is, ½ ρ̇ q̇ is ½ ∂²σ/∂q² Δq².
  //
  // The first correction Δ is followed at once by ½ ρ̇ q̇ with q̇′ = Δ, which is what the next one would be to second order
  // (Chebyshev's method, of third order): it must be so small a part of Δ, together with that next one.
  //
  // Later a factor serves two corrections (Shamanskii's method, of third order too). The second one, ψ̄ anew but ψ_q′ that
  // of the iterate before, is taken where it is at most a sixteenth of the first: with h half of ω‖Δ₁‖ it is at most
  // h‖Δ₁‖, and Newton's own at most h/(1 − 2h)‖Δ₁‖, a fourteenth (Deuflhard, Newton Methods for
  // Nonlinear Problems, 2004, sec. 2.1). Otherwise it is tried where corrections shrink so fast that it will be the last.
  // Where q′ alone is wanted the solution needs no ψ_q′ of its own if the last one's inverse times the way since is so
  // small that the determinant cannot vanish on it.
  // `linearized`: ψ_q′ is factorised at the start already, for the last one has ended there.
  bool newton(const Cluster& c, ClusterState& s, const double* q, const double* start, const Known* known, bool& open,
              bool linearized = false) {
    copy_cluster(c, start, q_free.data());
    factorized_ = false;
    const int first = known && c.n() ? 1 : 0;
    int sign = first ? known->sign : 0;
    shrank_ = 0;
    double last = 0, bend = 0;            // a correction, and ½ ρ̇ q̇
    double shrinking = 0, expected = 0;   // of corrections by the factor at hand, and how long the next is likely to be
    if (first) {
      last = tangent_step(c, s, q, known->rho);
      gap_.assign(s.right.begin(), s.right.begin() + c.direct.size());
      missing_.assign(c.rows(), 0.);
      std::copy_n(s.right.begin() + c.direct.size(), c.components.size(), missing_.begin() + c.phi_rows());
      if (!(last <= kLargestMove)) return false;
      if (last > kStraight && known->curvature.size()) bend = bend_known(c, s, known->curvature);
      if (!trusted(bend, last)) return false;
      move(c, s.step.data());
    }
    int served = 0;              // corrections that the factor at hand has made
    double inverse = 0, way = 0;  // the size of its inverse, and the length of these
    for (int iteration = first; iteration < kMaxNewton; ++iteration) {
      const bool there = linearized && iteration == 0;
      const double size = there ? gaps(c, s, q) : opening_ > 0 ? residuals_left(c, s, q) : residuals(c, s, q);
      const bool closed = size <= m.tolerance || (iteration && last <= kNoise && size <= 100 * m.tolerance);
      if (served && closed && !wants_rho_ && inverse * way <= kStill)
        if (const Turn turn = turn_since(before_, s); !turn.near_singular()) return clear(turn);
      if (served && !closed && last > kNoise && expected * shrinking <= m.tolerance) {
        const double length = newton_step(c, s);
        if (length <= kChord * last && (served == 1 || length * shrinking <= m.tolerance)) {
          shrinking = std::max(shrinking, length / last), shrank_ = std::max(shrank_, length / last), expected = length * shrinking;
          last = length, bend = 0, way += length, ++served;
          move(c, s.step.data());
          continue;
        }
      }
      if (!there) factorize(c, s);
      if (iteration == 0) {
        missing_ = s.residual, gap_ = s.gap;
        sign = s.factor.sign;
        for (int r = 0; r < c.phi_rows(); ++r) open |= std::abs(s.residual[r]) > kOpenStart;
      }
      if (too_singular(c, s) || s.factor.sign != sign) return false;
      if (closed) return (factorized_ = finish(c, s, true)) && (iteration == 0 || accepted(c, s, start, size));
      const double length = iteration && wants_rho_ ? newton_step(c, s) : probing_step(c, s, inverse);
      if (iteration == 0) before_ = s.probe;
      if (!(length <= kLargestMove)) return false;
      if (iteration && !trusted(bend + length, last)) return false;
      bend = iteration || length <= kStraight ? 0 : bend_here(c, s);
      if (!trusted(bend, length)) return false;
      shrinking = 2 * bend / length, expected = bend * shrinking;
      last = way = length;
      served = s.factor.ratio < kSuspiciousPivots ? 0 : bend > 0 ? 2 : 1;
      move(c, s.step.data());
    }
    return false;
  }
  bool trusted(double next, double last) {
    if (next <= kNoise) return true;
    shrank_ = std::max(shrank_, next / last);
    return next <= kContraction * last;
  }
  // Whether estimates hold by a wide margin, wider near singular sets.
  bool clear(const Turn& turn) const {
    const bool near = turn.near_singular();
    return shrank_ <= (near ? kNearSingular : 1) * kContraction && turn.change <= (near ? kNearSingular : kNarrow) * kTurn;
  }
  // Whether a solution is what the start is continued to: by such estimates, or near singular sets by proof.
  bool accepted(const Cluster& c, ClusterState& s, const double* start, double off) {
    const Turn turn = turn_since(before_, s);
    if (!turn.trusted()) return false;
    return clear(turn) || (turn.near_singular() && proved(c, s, start, missing_, gap_, off));
  }

  // Adds ½ ρ̇ q̇ with q̇′ the step to it, and returns its length: here, and by ∂²σ/∂q² at a closed start.
  double bend_here(const Cluster& c, ClusterState& s) {
    bias(c, s, s.step.data());
    double length = 0;
    for (int k = 0; k < c.width(); ++k) s.step[k] += 0.5 * s.bias[k], length += s.bias[k] * s.bias[k];
    return 0.5 * std::sqrt(length);
  }
  double bend_known(const Cluster& c, ClusterState& s, const std::vector<double>& curvature) const {
    const int n = c.n();
    const double *dq = s.right.data(), *h = curvature.data();  // of `tangent_step`
    double length = 0;
    for (int col = 0; col < c.width(); ++col) {
      double sum = 0;
      for (int i = 0; i < n; ++i)
        for (int j = 0; j <= i; ++j) sum += *h++ * dq[i] * dq[j];
      s.step[col] += sum, length += sum * sum;
    }
    return std::sqrt(length);
  }
  // ∂²σ/∂qᵢ∂qⱼ for j ≤ i, halved where i = j: width × n(n + 1)/2, from ρ̇ q̇ with q̇ along eᵢ and eᵢ + eⱼ. After ρ.
  void curvature(const Cluster& c, ClusterState& s, std::vector<double>& out) {
    const int n = c.n(), pairs = n * (n + 1) / 2, width = c.width();
    out.assign(size_t(width) * pairs, 0.);
    std::vector<double> v(width);
    const auto place = [&](int i, int j, int mixed) {
      for (int col = 0; col < width; ++col) v[col] = s.rho[col * n + i] + (j < i ? s.rho[col * n + j] : 0);
      bias(c, s, v.data());
      for (int col = 0; col < width; ++col) out[size_t(col) * pairs + mixed] = 0.5 * s.bias[col];
    };
    const auto at = [](int i, int j) { return i * (i + 1) / 2 + j; };
    for (int i = 0; i < n; ++i)
      for (int j = 0; j <= i; ++j) place(i, j, at(i, j));
    for (int col = 0; col < width; ++col) {
      double* h = &out[size_t(col) * pairs];
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < i; ++j) h[at(i, j)] -= h[at(i, i)] + h[at(j, j)];
    }
  }

  double tangent_step(const Cluster& c, ClusterState& s, const double* q, const double* rho) {
    const int n = c.n();
    whole_gaps(c, q, s.right.data());
    int at = int(c.direct.size());
    for (int i : c.components) s.right[at++] = component_gap(m.coordinates[i], q);
    double length = 0;
    for (int col = 0; col < c.width(); ++col) {
      double sum = 0;
      for (int i = 0; i < n; ++i) sum += rho[size_t(col) * n + i] * s.right[i];
      s.step[col] = sum, length += sum * sum;
    }
    return std::sqrt(length);
  }

  // Newton's step, with a probe and the size of ψ_q′⁻¹ besides.
  double probing_step(const Cluster& c, ClusterState& s, double& inverse) const {
    newton_right(c, s, 3);
    inverse = solve_beside_probe(c, s, 3);
    return step_from(c, s, 3);
  }

  // Along the straight line from α(start) to q, or until it is seen to end before.
  bool walk(const Cluster& c, ClusterState& s, const double* q, const double* start) {
    if (dead_end_.is(c, q, start)) return false;
    dead_end_.begin(c, m, q, start);
    set_line(c, q, start);
    Approach approach;
    const bool reached = follow(c, s, start, true, [&](double ahead) { target(c, q, ahead); }, [&](double done, double arc) {
      return approach.nears_end(done, arc, 1 / norm(s.probe)) && ends_before(c, s, q, approach);
    });
    if (!reached && dead_end_.done == 1) stopped(approach.done[2]);
    return reached;
  }
  // In steps that Newton trusts, halved where he does not and doubled after two that he did, from a start to q_ahead_ as
  // f(1) sets it; given up where `ends` says so of what is done, and of the last step's length. `closed`: φ shall be zero.
  template <class F, class G>
  bool follow(const Cluster& c, ClusterState& s, const double* start, bool closed, F&& f, G&& ends) {
    copy_cluster(c, start, here_.data());
    double done = 0, stride = 0.5;
    bool open = false, grows = true, linearized = false;
    while (stride >= kShortestStep) {
      const double ahead = std::min(1.0, done + stride);
      f(ahead);
      if (!newton(c, s, q_ahead_.data(), here_.data(), nullptr, open, linearized)) {
        stride *= 0.5, grows = linearized = false;
        continue;
      }
      if (ahead == 1) return true;
      const double arc = distance(c, here_.data(), q_free.data());
      copy_cluster(c, q_free.data(), here_.data());
      done = ahead, stride *= grows ? 2 : 1, grows = true;
      if (ends(done, arc)) return false;
      linearized = closed && factorized_ && same_cluster(c, q_free.data(), here_.data());
    }
    return false;
  }

  // Closes what is open at its own q, into `here_`: φ goes to zero along a straight line; false where that is blocked.
  bool close_start(const Cluster& c, ClusterState& s, const double* start) {
    alpha(start, q_ahead_.data());
    copy_cluster(c, start, q_free.data());
    residuals(c, s, nullptr);
    std::copy_n(s.residual.begin(), c.phi_rows(), open_by_.begin());
    const bool closed = follow(c, s, start, false, [&](double ahead) { opening_ = 1 - ahead; }, [](double, double) { return false; });
    opening_ = 0;
    if (closed) copy_cluster(c, q_free.data(), here_.data());
    return closed;
  }
  // The same as `residuals`, with what φ shall be.
  double residuals_left(const Cluster& c, ClusterState& s, const double* q) {
    residuals(c, s, q);
    double size = 0;
    for (int r = 0; r < c.phi_rows(); ++r) s.residual[r] -= opening_ * open_by_[r];
    for (double r : s.residual) size = std::max(size, std::abs(r));
    for (double g : s.gap) size = std::max(size, std::abs(g));
    return size;
  }
};

}  // namespace ccpin
