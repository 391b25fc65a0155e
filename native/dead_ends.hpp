// Where the way of σ ends: a singular configuration on the lift of a straight line, seen from before it and gone up to.
//
// Let d be what is left of the way up to it, and Y = ψ_q′⁻¹ B (`solve_beside_probe`). At a fold, where the lift turns back,
// q′ = q′* + b √d + O(d) and 1/|Y|² is proportional to d(1 + O(√d)). At a crossing, where q′ goes on but det ψ_q′ changes
// its sign, q′ is smooth and 1/|Y| proportional to d(1 + O(d)). What such a law calls g is a straight line into zero; next
// to what is passed by it bends away (near an isolated singular point 1/|Y| ~ √(d² + ε²)). Where three points of the walk
// lie nearly on a line, q′ is followed up to the end in leaps that leave a 4th to a 64th of d, begun by the law and closed
// by Newton's method. After each Y must have its direction, which it turns where det ψ_q′ changes its sign, and g tells
// anew where the end is, until it is where it was. So down to the walk's shortest step, or to where rounding decides: the
// walk is trusted as long as |Y|² times the tolerance of closed points is at most `kRounded`, which g says is where. It
// would stop between two places, then; if q lies beyond these, and has one name from both, singular or out of reach, it is
// refused. So it is after a walk that went on until no step was trusted, if q lies well beyond. Otherwise nothing is said:
// what the walk answers depends on none of this. (ccpin.kinematics.dead_ends leaps as well, later and with less to say.)
#pragma once
#include "continuation.hpp"

#include <cstring>

namespace ccpin {

constexpr double kNoise = 1e-9, kLargestMove = 1, kShortestStep = 0x1p-30;
constexpr double kLine = 0.5;           // of the slope of g: it may change by less over three points,
constexpr double kSeenFrom = 0.1;       // of what is left: so far apart these are at least
constexpr double kFollowed = 4;         // times what is left: a leap may find so much more or less,
constexpr double kSure = 0.03;          // of what is left: the last leap this, the one before eight times as much
constexpr double kDoubts = 8;           // times the last change of where the end is: it may be so far off
constexpr double kSameDirection = 0.9;  // of the cosine between Y before and after a leap
constexpr double kResolved = 1e-2;      // |Y|² times the tolerance of closed points: rounding's share of g
constexpr double kRoundedAlike = 0.9;   // of what rounding leaves of the way: the walk stops there, give or take,
constexpr double kStopsWithin = 16 * kShortestStep;  // and its steps lead so near at least, if rounding lets them
constexpr double kStoppedAlike = 1e-5;  // of the way: so much farther at most may others walk that take other steps
constexpr int kMostLeaps = 32, kMostSettling = 10;

enum class Ending { fold, crossing };
// g, of |Y|².
inline double line_of(Ending kind, double square) { return kind == Ending::fold ? 1 / square : 1 / std::sqrt(square); }

// The last three points of a walk: how much was done, and |Y|² there.
struct Approach {
  double done[3] = {0, 0, 0}, square[3] = {0, 0, 0};
  int count = 0;
  Ending kind = Ending::fold;
  double left = 0, end = 0;  // of the way up to its end, and where that is
  double next = INFINITY;    // not looked for where more is left than this

  // Whether an end is ahead, not clearly behind q.
  bool nears_end(double place, double value) {
    for (int k = 0; k < 2; ++k) done[k] = done[k + 1], square[k] = square[k + 1];
    done[2] = place, square[2] = value;
    if (++count < 3) return false;
    double bent = kLine;
    left = INFINITY;
    for (Ending each : {Ending::fold, Ending::crossing}) {
      const double a = line_of(each, square[0]), b = line_of(each, square[1]), c = line_of(each, square[2]);
      const double before = (b - a) / (done[1] - done[0]), slope = (c - b) / (done[2] - done[1]);
      if (!(before < 0 && slope < 0 && std::abs(slope / before - 1) < bent)) continue;
      bent = std::abs(slope / before - 1), kind = each, left = -c / slope;
    }
    end = place + left;
    return left < next && done[2] - done[0] >= kSeenFrom * left && end <= 1 + 0.25 * left;
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
    double place = a.done[2], left = a.left, end = a.end, doubt = 0.1 * left;
    a.next = left / 4;  // where nothing comes of it
    copy_cluster(c, here_.data(), q_free.data());
    target(c, q, place);
    linearize(c, s, q_ahead_.data());
    if (!(s.factor.ratio > 0)) return false;
    probe(c, s);
    double g = line_of(a.kind, probe_square(s)), resolved = kResolved, astray = INFINITY;
    for (int leap = 0; leap < kMostLeaps; ++leap) {
      const double least = left * line_of(a.kind, 2 * resolved / m.tolerance) / g;
      const double goal = std::max({4 * kShortestStep, std::clamp(4 * doubt, left / 64, left / 4), least});
      if (!(goal < left)) return false;
      if (!leaps(c, s, q, a.kind, end, left, goal)) return false;
      const double ahead = end - goal, square = probe_square(s), now = line_of(a.kind, square);
      left = -now * (ahead - place) / (now - g);
      if (!(now < g && left <= kFollowed * goal && goal <= kFollowed * left)) return false;
      doubt = std::abs(ahead + left - end), end = ahead + left, place = ahead, g = now;
      const double unseen = left * line_of(a.kind, kRounded / m.tolerance) / now;  // where rounding decides
      const double to = end + kDoubts * doubt - std::max(kRoundedAlike * unseen, 0.5 * kShortestStep);
      if (!(to - 2 * kDoubts * doubt <= 1)) return false;
      const double unsure = std::max(doubt / goal, 0.125 * astray);
      astray = doubt / goal;
      if (goal > 8 * kShortestStep && m.tolerance * square < resolved) continue;
      if (unsure <= kSure && place < 1) {
        if (!(to <= 1)) return false;
        const double from = end - kDoubts * doubt - std::max(unseen / kRoundedAlike, kStopsWithin);
        dead_end_.done = place, dead_end_.q_free = q_free, dead_end_.from = from, dead_end_.to = to;
        if (from > place && leaps(c, s, q, a.kind, end, end - place, end - from))
          dead_end_.done = from, dead_end_.q_free = q_free;
        return true;
      }
      if (goal <= 8 * kShortestStep || resolved > kRounded / 16) return false;
      resolved *= 4;  // not sure as yet: nearer
    }
    return false;
  }

  // Of a walk that went on until no step was trusted, into `dead_end_`: others may stop a little before or behind.
  void stopped(double done) {
    dead_end_.done = done, dead_end_.q_free = here_, dead_end_.to = done + kStoppedAlike;
    dead_end_.from = -INFINITY;
  }

  static double probe_square(const ClusterState& s) {
    double sum = 0;
    for (double y : s.probe) sum += y * y;
    return sum;
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
  std::vector<double> before_leap_;  // Y

  void probe(const Cluster& c, ClusterState& s) const { solve_beside_probe(c, s, 2); }
  static double cosine(const std::vector<double>& a, const std::vector<double>& b) {
    double ab = 0, aa = 0, bb = 0;
    for (size_t k = 0; k < a.size(); ++k) ab += a[k] * b[k], aa += a[k] * a[k], bb += b[k] * b[k];
    return ab / std::sqrt(aa * bb);
  }
  // The rate of q′ as more of the way is done, into s.step.
  void tangent(const Cluster& c, ClusterState& s) const {
    std::fill(s.residual.begin(), s.residual.end(), 0.);
    int row = c.phi_rows();
    for (int i : c.components) s.residual[row++] = line_[m.coordinates[i].v];
    double* gap = s.gap.data();
    for (int i : c.whole) {
      const Coordinate& k = m.coordinates[i];
      gap = std::copy_n(line_.data() + k.v, k.nv, gap);
    }
    newton_step(c, s);
  }
  // From where `left` is left of the way to its end to where `goal` is, Y in the same direction.
  bool leaps(const Cluster& c, ClusterState& s, const double* q, Ending kind, double end, double left, double goal) {
    before_leap_ = s.probe;
    tangent(c, s);
    for (double& x : s.step) x *= kind == Ending::fold ? 2 * (left - std::sqrt(left * goal)) : left - goal;
    move(c, s.step.data());
    target(c, q, end - goal);
    return settles(c, s) && cosine(before_leap_, s.probe) >= kSameDirection;
  }
  // Newton's method to the q aimed at, in corrections that are halved at least each time.
  bool settles(const Cluster& c, ClusterState& s) {
    double last = INFINITY;
    for (int iteration = 0; iteration < kMostSettling; ++iteration) {
      const double size = linearize(c, s, q_ahead_.data());
      if (!(s.factor.ratio > 0)) return false;
      if (size <= m.tolerance || (last <= kNoise && size <= 100 * m.tolerance)) {
        probe(c, s);
        return true;
      }
      const double length = newton_step(c, s);
      if (!(length <= std::max(kNoise, std::min(kLargestMove, 0.5 * last)))) return false;
      move(c, s.step.data());
      last = length;
    }
    return false;
  }
};

}  // namespace ccpin
