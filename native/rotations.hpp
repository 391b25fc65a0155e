// Rotations: unit quaternions (x, y, z, w), rotation vectors r = log R, and ṙ = J(r) ω with ω in the moving frame.
#pragma once
#include "spatial.hpp"

#include <cmath>

namespace ccpin {

inline Eigen::Quaterniond quaternion(const double* q) { return {q[3], q[0], q[1], q[2]}; }

inline Vec3 log_rotation(const Eigen::Quaterniond& q) {
  const double s = q.vec().norm(), sign = q.w() < 0 ? -1 : 1;
  if (s < 1e-30) return Vec3::Zero();
  return (sign * 2 * std::atan2(s, sign * q.w()) / s) * q.vec();
}

inline Eigen::Quaterniond exp_rotation(const Vec3& r) {
  const double a = r.norm(), s = a < 1e-8 ? 0.5 - a * a / 48 : std::sin(0.5 * a) / a;
  return {std::cos(0.5 * a), s * r.x(), s * r.y(), s * r.z()};
}

inline Mat3 about(const Vec3& a, double c, double s) {  // the rotation with cosine c and sine s about a unit axis
  const double k = 1 - c;
  Mat3 R;
  R << c + k * a.x() * a.x(), k * a.x() * a.y() - s * a.z(), k * a.x() * a.z() + s * a.y(),
       k * a.x() * a.y() + s * a.z(), c + k * a.y() * a.y(), k * a.y() * a.z() - s * a.x(),
       k * a.x() * a.z() - s * a.y(), k * a.y() * a.z() + s * a.x(), c + k * a.z() * a.z();
  return R;
}
inline Mat3 about_z(double c, double s) {
  Mat3 R;
  R << c, -s, 0, s, c, 0, 0, 0, 1;
  return R;
}

// c(t) = 1/t − cot(θ/2)/(2θ) with t = θ² = |r|², and its first two derivatives by t: J(r) = I + ½[r]× + c [r]ײ.
struct LogCoefficients {
  double c, c_t, c_tt;
  explicit LogCoefficients(double t) {
    if (t < 1) {  // |B₂ₖ|/(2k)! tᵏ⁻¹, convergent for t < 4π²
      static const double series[] = {1. / 12, 1. / 720, 1. / 30240, 1. / 1209600, 1. / 47900160,
                                      691. / 1307674368000, 1. / 74724249600, 3617. / 10670622842880000,
                                      43867. / 5109094217170944000, 174611. / 802857662698291200000.};
      c = c_t = c_tt = 0;
      for (int k = 9; k >= 0; --k) {
        c = c * t + series[k];
        if (k > 0) c_t = c_t * t + k * series[k];
        if (k > 1) c_tt = c_tt * t + k * (k - 1) * series[k];
      }
      return;
    }
    const double theta = std::sqrt(t), cot = 1 / std::tan(0.5 * theta), square = 1 + cot * cot;
    c = 1 / t - cot / (2 * theta);
    c_t = -1 / (t * t) + cot / (4 * theta * t) + square / (8 * t);
    c_tt = 2 / (t * t * t) - 3 * cot / (8 * theta * t * t) - 3 * square / (16 * t * t) - cot * square / (16 * theta * t);
  }
};

}  // namespace ccpin
