// Where the way of σ ends: a singular configuration on the lift of a straight line, seen from before it and gone up to.
//
// Let h = 1/|Y| with Y = ψ_q′⁻¹ B (`solve_beside_probe`), and s the arc of the lift. Where det ψ_q′ is a simple zero along
// the lift h falls into it on a straight line, h ∝ s(1 + O(s)) from there: at a fold, where the lift turns back and so
// dt/ds vanishes as well, as at a crossing, where q′ goes on but det ψ_q′ changes its sign. Next to what is passed by it
// bends away (near an isolated singular point h ~ √(s² + ε²)). Where three points of the walk lie nearly on a line, the lift
// is followed up to the end in leaps that leave a 4th to a 64th of its arc, along its tangent and closed by Newton's
// method across it: that system is regular at a fold, so that it leads as near as wanted. After each det ψ_q′ must have its
// sign and Y its direction, which it turns where the sign changes, and h tells anew where the end is, until it is where it
// was; dt/ds, linear in the arc, says how much of the way that is. So down to the walk's shortest step, or to where
// rounding decides: the walk is trusted as long as |Y|² times the tolerance of closed points is at most `kRounded`, which h
// says is where. It would stop between two places, then; if q lies beyond these, and has one name from both, singular or out
// of reach, it is refused. So it is after a walk that went on until no step was trusted, if q lies well beyond. Otherwise
// nothing is said: what the walk answers depends on none of this. (ccpin.kinematics.dead_ends leaps as well, later and with
// less to say.)
#pragma once
#include "continuation.hpp"

#include <cstring>
#include <numeric>

namespace ccpin {

constexpr double kNoise = 1e-9, kLargestMove = 1, kShortestStep = 0x1p-30;
constexpr double kLine = 0.5;           // of the slope of h: it may change by less over three points,
constexpr double kSeenFrom = 0.1;       // of what is left: so far apart these are at least
constexpr double kFollowed = 4;         // times the arc that is left: a leap may find so much more or less,
constexpr double kBent = 0.03125;       // of a leap: the first correction after it
constexpr double kShortest = 0.85;      // of the arc left: no leap leaves more, where longer ones are not trusted
constexpr double kSure = 0.03;          // of the arc left: the last leap finds so much more or less, the one before 8 times
constexpr double kDoubts = 2;           // times the last change of where the end is: it may be so far off
constexpr double kSharp = 0.05;         // of what rounding leaves of the way: so sharply is the end known, or to half a step
constexpr double kSameDirection = 0.9;  // of the cosine between Y before and after a leap
constexpr double kResolved = 1e-2;      // |Y|² times the tolerance of closed points: leaps lead so near, or to a step,
constexpr double kBeyond = 16;          // and no nearer than this
constexpr double kRoundedAlike = 0.97;  // of what rounding leaves of the way: the walk stops there, give or take,
constexpr double kStopsWithin = 16 * kShortestStep;  // and its steps lead so near at least, if rounding lets them
constexpr double kStoppedAlike = 1e-5;  // of the way: so much farther at most may others walk that take other steps
constexpr int kMostLeaps = 32, kMostSettling = 10;

// The end of a lift, seen from a place on it: what arc of the lift is left up to it, how much of the way an arc leads there
// (dt/ds), and how that changes with the arc.
struct Sight {
  double arc = INFINITY, rate = 0, bend = 0;
  // At the end; a rate that would be negative there vanishes there.
  double rate_there() const { return std::max(rate + bend * arc, 0.); }
  double slope() const { return rate + bend * arc < 0 ? -rate / arc : bend; }
  // How much of the way is left where an arc is, and the reverse.
  double way(double left) const { return left * (rate_there() - 0.5 * slope() * left); }
  double arc_of(double way) const {
    const double rate = rate_there();
    return 2 * way / (rate + std::sqrt(std::max(0., rate * rate - 2 * slope() * way)));
  }
};

// The last three places of a walk: how much was done, along what arc, and 1/|Y| there.
struct Approach {
  double done[3] = {0, 0, 0}, along[3] = {0, 0, 0}, height[3] = {0, 0, 0};
  int count = 0;
  Sight sight;
  double next = INFINITY;  // of the way: an end is not looked for where more is left than this

  // Whether an end is ahead, not clearly behind q.
  bool nears_end(double place, double arc, double inverse) {
    for (int k = 0; k < 2; ++k) done[k] = done[k + 1], along[k] = along[k + 1], height[k] = height[k + 1];
    done[2] = place, along[2] += arc, height[2] = inverse;
    if (++count < 3) return false;
    const double first = along[1] - along[0], last = along[2] - along[1];
    const double before = (height[1] - height[0]) / first, slope = (height[2] - height[1]) / last;
    if (!(before < 0 && slope < 0 && std::abs(slope / before - 1) < kLine)) return false;
    const double rate = (done[2] - done[1]) / last;
    sight.arc = -height[2] / slope, sight.bend = 2 * (rate - (done[1] - done[0]) / first) / (first + last);
    sight.rate = std::max(rate + 0.5 * sight.bend * last, 0.25 * rate);
    const double left = sight.way(sight.arc);
    return left < next && done[2] - done[0] >= kSeenFrom * left && place + left <= 1 + 0.25 * left;
  }
};

// The last one that was found, and on which way.
class DeadEnd {
 public:
  double done = 1;             // how much of the way leads next to it,
  std::vector<double> q_free;  // q′ there,
  double from = 1, to = 1;     // and between what and what the walk stops
  bool is(const Cluster& c, const double* q, const double* start) const {
    return done < 1 && cluster_ == &c && std::memcmp(q, q_.data(), sizeof(double) * q_.size()) == 0 &&
           std::memcmp(start, start_.data(), sizeof(double) * start_.size()) == 0;
  }
  void begin(const Cluster& c, const Mechanism& m, const double* q, const double* start) {
    done = 1, cluster_ = &c, q_.assign(q, q + m.n_q), start_.assign(start, start + m.nq);
  }

 private:
  const Cluster* cluster_ = nullptr;
  std::vector<double> q_, start_;
};

class DeadEnds : public Continuation {
 public:
  explicit DeadEnds(const Mechanism& mechanism) : Continuation(mechanism) {
    q_start_.resize(m.n_q), q_ahead_.resize(m.n_q), line_.resize(m.n), here_.resize(m.nq);
  }

  // q = α(q′).
  void alpha(const double* configuration, double* q) const {
    for (const Coordinate& k : m.coordinates) {
      const double* x = configuration + m.joints[k.joint].q;
      if (k.whole()) std::copy(x, x + k.nq, q + k.q);
      else q[k.q] = component(k, x);
    }
  }

 protected:
  std::vector<double> q_start_, q_ahead_, line_;  // of a walk: α of its start, α aimed at, and the way from start to end
  std::vector<double> here_;                      // q′ that it came to
  DeadEnd dead_end_;

  void set_line(const Cluster& c, const double* q, const double* start) {
    alpha(start, q_start_.data());
    for (int i : c.coordinates) {
      const Coordinate& k = m.coordinates[i];
      coordinate_difference(k, q_start_.data() + k.q, q + k.q, line_.data() + k.v);
    }
  }
  void target(const Cluster& c, const double* q, double ahead) {
    for (int i : c.coordinates) {
      const Coordinate& k = m.coordinates[i];
      const double* from = ahead == 1 ? q : q_start_.data();
      std::copy(from + k.q, from + k.q + k.nq, q_ahead_.data() + k.q);
      if (ahead == 1) continue;
      double step[6];
      for (int j = 0; j < k.nv; ++j) step[j] = ahead * line_[k.v + j];
      coordinate_retract(k, q_ahead_.data() + k.q, step);
    }
  }

  // Whether the way to q ends where an end is neared at `here_`, into `dead_end_`.
  bool ends_before(const Cluster& c, ClusterState& s, const double* q, Approach& a) {
    Sight sight = a.sight;
    double place = a.done[2], end = place + sight.way(sight.arc), doubt = 0.1 * sight.arc, astray = INFINITY;
    a.next = (end - place) / 4;  // where nothing comes of it
    copy_cluster(c, here_.data(), q_free.data());
    target(c, q, place);
    examine(c, s);
    if (!(s.factor.ratio > 0)) return false;
    sight.rate = 1 / norm(rate_);
    double height = 1 / norm(s.probe);
    for (int leap = 0; leap < kMostLeaps; ++leap) {
      const double arc = sight.arc, least = arc * std::sqrt(m.tolerance / kBeyond) / height;
      double goal = std::max(std::clamp(4 * doubt, arc / 64, arc / 4), least), ahead = end - sight.way(goal);
      if (!(goal < arc)) return false;
      while (!(leaps(c, s, q, arc - goal, ahead) && ahead > place)) {
        goal = 0.5 * (goal + arc), ahead = end - sight.way(goal);
        if (!(goal <= kShortest * arc)) return false;
        q_free = begun_, target(c, q, place), examine(c, s);
      }
      const double made = distance(c, begun_.data(), q_free.data()), now = 1 / norm(s.probe), rate = 1 / norm(rate_);
      sight = {now * made / (height - now), rate, (rate - sight.rate) / made};
      if (!(now < height && sight.arc <= kFollowed * goal && goal <= kFollowed * sight.arc)) return false;
      const double left = sight.way(sight.arc), moved = std::abs(ahead + left - end);
      doubt = std::abs(sight.arc - goal), end = ahead + left, place = ahead, height = now;
      const double unseen = sight.way(sight.arc * std::sqrt(m.tolerance / kRounded) / height);  // where rounding decides
      const double to = end + kDoubts * moved - std::max(kRoundedAlike * unseen, 0.5 * kShortestStep);
      if (!(to - 2 * kDoubts * moved <= 1)) return false;
      const double unsure = std::max(doubt / goal, 0.125 * astray);
      astray = doubt / goal;
      if (left > 8 * kShortestStep && m.tolerance < kResolved * height * height) continue;
      if (unsure <= kSure && kDoubts * moved <= std::max(kSharp * unseen, 0.5 * kShortestStep)) {
        if (!(to <= 1)) return false;
        const double from = end - kDoubts * moved - std::max(unseen / kRoundedAlike, kStopsWithin);
        dead_end_.from = from, dead_end_.to = to, dead_end_.q_free = q_free;
        double there = from;
        if (leaps(c, s, q, sight.arc - sight.arc_of(end - from), there)) dead_end_.q_free = q_free;
        else there = place;
        if (!(there < 1)) return false;
        dead_end_.done = there;
        return true;
      }
    }
    return false;
  }

  // Of a walk that went on until no step was trusted, into `dead_end_`: others may stop a little before or behind.
  void stopped(double done) {
    dead_end_.done = done, dead_end_.q_free = here_, dead_end_.to = done + kStoppedAlike;
    dead_end_.from = -INFINITY;
  }

  static double norm(const std::vector<double>& x) {
    double sum = 0;
    for (double each : x) sum += each * each;
    return std::sqrt(sum);
  }
  // Of two configurations of a cluster, in its columns.
  double distance(const Cluster& c, const double* from, const double* to) {
    apart_.resize(c.width());
    for (int j : c.joints) {
      const Joint& joint = m.joints[j];
      difference(joint.kind, from + joint.q, to + joint.q, apart_.data() + m.column_of[joint.v]);
    }
    return norm(apart_);
  }

  double newton_step(const Cluster& c, ClusterState& s) const {
    newton_right(c, s, 1);
    s.factor.solve(s.right.data(), 1);
    return step_from(c, s, 1);
  }
  void newton_right(const Cluster& c, ClusterState& s, int stride) const {
    const int rows = c.rows(), direct = int(c.direct.size());
    const double *J = s.J.data() + c.unknowns(), *gap = s.gap.data();
    for (int r = 0; r < rows; ++r, J += c.width()) {
      double sum = s.residual[r];
      for (int k = 0; k < direct; ++k) sum -= J[k] * gap[k];
      s.right[size_t(r) * stride] = sum;
    }
  }
  double step_from(const Cluster& c, ClusterState& s, int stride) const {
    scatter(c, s.right.data(), stride, 1, s.step.data());
    for (size_t k = 0; k < c.direct.size(); ++k) s.step[c.direct[k]] = s.gap[k];
    double length = 0;
    for (double x : s.step) length += x * x;
    return std::sqrt(length);
  }

  void move(const Cluster& c, const double* step) {
    for (int j : c.joints) retract(m.joints[j].kind, q_free.data() + m.joints[j].q, step + m.column_of[m.joints[j].v]);
  }

 private:
  std::vector<double> before_leap_, begun_, heading_;  // Y, q′ and the direction of the lift where a leap begins
  std::vector<double> rate_, apart_;                   // dq′/dt on the way; a difference

  static double inner(const std::vector<double>& a, const std::vector<double>& b) {
    return std::inner_product(a.begin(), a.end(), b.begin(), 0.);
  }
  // ψ̄ at the q aimed at: its size, Newton's correction (s.step), the rate of q′ as more of the way is done, and Y.
  double examine(const Cluster& c, ClusterState& s) {
    const double size = linearize(c, s, q_ahead_.data());
    newton_right(c, s, 4);
    rate_.assign(c.width(), 0.);
    double* rate = rate_.data();
    size_t at = 0;
    for (int i : c.whole)
      for (int k = 0; k < m.coordinates[i].nv; ++k) rate[c.direct[at++]] = line_[m.coordinates[i].v + k];
    double* right = s.right.data() + 1;
    const double* J = s.J.data() + c.unknowns();
    for (int r = 0; r < c.rows(); ++r, right += 4, J += c.width()) {
      *right = r < c.phi_rows() ? 0 : line_[m.coordinates[c.components[r - c.phi_rows()]].v];
      for (size_t k = 0; k < c.direct.size(); ++k) *right -= J[k] * rate[c.direct[k]];
    }
    solve_beside_probe(c, s, 4);
    step_from(c, s, 4);
    scatter(c, s.right.data() + 1, 4, 1, rate);
    return size;
  }
  // Along the lift by an arc, to about `ahead` of the way and to where that leads; Y in the same direction.
  bool leaps(const Cluster& c, ClusterState& s, const double* q, double arc, double& ahead) {
    before_leap_ = s.probe, begun_ = q_free, heading_ = rate_;
    const int sign = s.factor.sign;
    const double length = norm(heading_);
    for (size_t k = 0; k < s.step.size(); ++k) s.step[k] = arc / length * rate_[k];
    move(c, s.step.data());
    return settles(c, s, q, std::abs(arc), ahead) && s.factor.sign == sign &&
           inner(before_leap_, s.probe) >= kSameDirection * norm(before_leap_) * norm(s.probe);
  }
  // Newton's method to the lift across the way it headed, in corrections that are halved at least each time: a bordered
  // system, which is regular at a fold.
  bool settles(const Cluster& c, ClusterState& s, const double* q, double arc, double& ahead) {
    double last = 2 * kBent * arc;
    for (int iteration = 0; iteration < kMostSettling; ++iteration) {
      target(c, q, ahead);
      const double size = examine(c, s);
      if (!(s.factor.ratio > 0)) return false;
      if (size <= m.tolerance || (last <= kNoise && size <= 100 * m.tolerance)) return true;
      const double more = -inner(heading_, s.step) / inner(heading_, rate_);
      for (size_t k = 0; k < s.step.size(); ++k) s.step[k] += more * rate_[k];
      const double length = norm(s.step);
      if (!(length <= std::max(kNoise, std::min(kLargestMove, 0.5 * last)))) return false;
      move(c, s.step.data());
      ahead += more, last = length;
    }
    return false;
  }
};

}  // namespace ccpin
