// φ(θ) = Σ_c B_c x_c(θ) + Gθ + d over serial chains (`proof/chains.py`), its Jacobian, and its planar form.
//
// **Rounding.** Every entry of φ, φ_θ and φ_θθ computed here is within γ · magnitude of the exact one, with the γ and the
// magnitude of `ClosureSystem`: γ = (128(k + 2) + 4n′)u for chains of up to k joints. Hypotheses: IEEE arithmetic, no
// contraction to fused operations, sin and cos to one unit in the last place, placements and axes orthonormal within 8u
// (the reader of `certifier.hpp` declines others). Proof, in Frobenius norms, to first order in u:
//   A joint's turn R_j E(θ) = R_j aaᵀ + cos θ (R_j − R_j aaᵀ) + sin θ R_j[a]× has coefficient matrices made once, with
//   errors of at most 6.2u, 7.2u and 4.9u, and norms 1, √2 and √2. Sine and cosine (2u each) add 4u, the products 2u, the
//   two sums 3.5u: 28u. The product with the rotation above it adds 9u, so the k-th rotation is within 37ku.
//   An axis adds 5.2u. An arm x − o_j sums k vectors, each turned with 37ku: within (37k + 2k + 6)u of the chain's length ℓ.
//   b = a × (x − o) is then within (76k + 15)uℓ, and a_i × b_j, the second derivative, within (113k + 24)uℓ.
//   Data that are orthonormal within 8u only, and so make these formulas inexact, add 3 · 8u at most. Weights and the sum
//   over the chains of a row: at most (3 + n′)u more. The total is below γ times Σ_c ‖row of B_c‖ ℓ_c ≤ magnitude.
// In the planar form an angle is a sum of at most k ≤ 30 entries of θ, of at most 4 rad each (the magnitude grows where
// they are larger): within 4k²u; its sine and cosine, weights and sums add 6u and at most (3 + n′)u.
// Products Ãφ, ÃφD, Eᵀ(Ãφ_θθ)D with at most n′ terms a sum add (3n′ + 6)u times the absolute values; with |φ_…| ≤ magnitude
// that is inside the 4n′u and the 128 · 2u of γ. So the margins of `proof/bounds.py` hold for this order of operations.
#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <vector>

namespace ccpin::certificates {

using V3 = Eigen::Vector3d;
using M3 = Eigen::Matrix3d;
using Doubles = std::vector<double>;

struct ChainJoint {
  int column;              // in θ
  bool slides;
  M3 fixed, cosine, sine;  // the frame before the joint, turned by it: fixed + cos θ · cosine + sin θ · sine
  V3 translation, axis;    // the axis in axes of the frame above the joint
  double length;           // of the translation
};
struct ChainRow {
  int row;
  V3 weight;
};
struct Chain {
  std::vector<ChainJoint> joints;
  std::vector<ChainRow> rows;  // those with a weight
  V3 tip;
  double tip_length;
  bool direction;
  double largest_weight;       // of a row, at least 1
  int first;                   // of its joints among those of all chains
};
struct Coupling {
  int row, column;
  double ratio;
};

// φ = Σ_j ℓ_j (P_j cos Φ_j + Q_j sin Φ_j) + Gθ + d, Φ = Cθ (`proof/phasors.py`).
struct Phasors {
  int count = 0;
  Doubles signs, lengths, cosine_weights, sine_weights, linear, offset;  // C (K, n′), ℓ, P (m, K), Q (m, K), G (m, n′), d
};

// φ, φ_θ (m, n′) at a θ; of chains a and b = ∂x/∂θ of every joint, of phasors z and iz in φ (m, K).
struct Values {
  Doubles phi, jacobian, along, across, cosine, sine;
  std::vector<V3> a, b;
};

class Closures {
 public:
  int n = 0, m = 0, n_free = 0;
  std::vector<int> independent, dependent;
  std::vector<char> periodic;
  std::vector<Chain> chains;
  std::vector<Coupling> couplings;
  Doubles offset, moduli;
  double scale = 1, gamma = 0;
  bool planar = false;
  Phasors phasors;
  int joints = 0;  // of all chains

  // An upper bound of every length in φ at θ; beyond 4 rad it grows with the angles.
  double magnitude(const double* theta) const {
    double total = scale, largest = 4;
    for (int k = 0; k < n_free; ++k) largest = std::max(largest, std::abs(theta[k]));
    for (const Chain& c : chains)
      for (const ChainJoint& j : c.joints)
        if (j.slides) total += std::abs(theta[j.column]) * c.largest_weight;
    return total * (largest / 4);
  }

  void evaluate(const double* theta, Values& v) const { planar ? evaluate_phasors(theta, v) : evaluate_chains(theta, v); }

  // By the chains, in the planar form too.
  void evaluate_chains(const double* theta, Values& v) const {
    v.phi = offset, v.jacobian.assign(size_t(m) * n_free, 0.);
    v.a.resize(joints), v.b.resize(joints), v.cosine.resize(n_free), v.sine.resize(n_free);
    for (int k = 0; k < n_free; ++k) v.cosine[k] = std::cos(theta[k]), v.sine[k] = std::sin(theta[k]);
    for (const Coupling& g : couplings) {
      v.phi[g.row] += g.ratio * theta[g.column];
      v.jacobian[g.row * n_free + g.column] = g.ratio;
    }
    for (int r = 0; r < m; ++r)
      if (moduli[r] != 0) v.phi[r] -= moduli[r] * std::nearbyint(v.phi[r] / moduli[r]);
    for (const Chain& c : chains) add_chain(c, theta, v);
  }

  // φ_θθ (m, n′, n′) after `evaluate_chains`: ∂²x/∂θ_i∂θ_j = a_i × b_j for i ≤ j along a chain.
  void second(const Values& v, double* out) const {
    std::fill_n(out, size_t(m) * n_free * n_free, 0.);
    for (const Chain& c : chains) {
      const V3 *a = v.a.data() + c.first, *b = v.b.data() + c.first;
      for (size_t i = 0; i < c.joints.size(); ++i)
        for (size_t j = i; j < c.joints.size(); ++j) {
          const V3 bent = a[i].cross(b[j]);
          const int p = c.joints[i].column, q = c.joints[j].column;
          for (const ChainRow& r : c.rows) {
            const double entry = r.weight.dot(bent);
            double* H = out + size_t(r.row) * n_free * n_free;
            H[p * n_free + q] += entry;
            if (i != j) H[q * n_free + p] += entry;
          }
        }
    }
  }

 private:
  // Adds a chain's tip to φ and B_c b to φ_θ; fills its a (zero where a joint slides) and b.
  void add_chain(const Chain& c, const double* theta, Values& v) const {
    V3 *a = v.a.data() + c.first, *b = v.b.data() + c.first, origin = V3::Zero();
    M3 turn = M3::Identity();
    for (size_t k = 0; k < c.joints.size(); ++k) {
      const ChainJoint& j = c.joints[k];
      origin += turn * j.translation;
      a[k].noalias() = turn * j.axis, b[k] = origin;
      if (j.slides) origin += theta[j.column] * a[k];
      const M3 moved = j.slides ? j.fixed : M3(j.fixed + v.cosine[j.column] * j.cosine + v.sine[j.column] * j.sine);
      turn = (turn * moved).eval();
    }
    V3 x = turn * c.tip;
    if (!c.direction) x += origin;
    for (size_t k = 0; k < c.joints.size(); ++k) {
      if (c.joints[k].slides) {
        b[k] = c.direction ? V3(V3::Zero()) : a[k], a[k].setZero();
      } else {
        b[k] = a[k].cross(c.direction ? x : V3(x - b[k]));
      }
      for (const ChainRow& r : c.rows) v.jacobian[r.row * n_free + c.joints[k].column] += r.weight.dot(b[k]);
    }
    for (const ChainRow& r : c.rows) v.phi[r.row] += r.weight.dot(x);
  }

  void evaluate_phasors(const double* theta, Values& v) const {
    const Phasors& p = phasors;
    const int K = p.count;
    v.phi = p.offset, v.jacobian = p.linear, v.cosine.resize(K), v.sine.resize(K);
    v.along.resize(size_t(m) * K), v.across.resize(size_t(m) * K);
    for (int k = 0; k < K; ++k) {
      double angle = 0;
      for (int c = 0; c < n_free; ++c) angle += p.signs[k * n_free + c] * theta[c];
      v.cosine[k] = p.lengths[k] * std::cos(angle), v.sine[k] = p.lengths[k] * std::sin(angle);
    }
    for (int r = 0; r < m; ++r) {
      double sum = 0;
      for (int k = 0; k < K; ++k) {
        const double P = p.cosine_weights[r * K + k], Q = p.sine_weights[r * K + k];
        const double along = P * v.cosine[k] + Q * v.sine[k], across = Q * v.cosine[k] - P * v.sine[k];
        v.along[r * K + k] = along, v.across[r * K + k] = across, sum += along;
        for (int c = 0; c < n_free; ++c) v.jacobian[r * n_free + c] += across * p.signs[k * n_free + c];
      }
      for (int c = 0; c < n_free; ++c) sum += p.linear[r * n_free + c] * theta[c];
      v.phi[r] += sum;
    }
  }
};

}  // namespace ccpin::certificates
