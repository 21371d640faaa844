// SPDX-License-Identifier: MIT
// Signed distance at a place: local implicits of the nearest rules blended by fuzzy basis functions, eq. (9).
#pragma once
#include "inference.hpp"

namespace sofnn {

// value[0]: blended distance; value[1]: support, the largest membership of x in a rule (1 on the data, 0 far away).
inline void evaluate_field(const KdTree& tree, const RuleView& rules, Vec3 x, int64_t k, InferenceScratch& s,
                           double* value) {
  tree.nearest(x, k, 1e300, s.neighbors);
  const int64_t n = static_cast<int64_t>(s.neighbors.size());
  s.log_weight.resize(n), s.normal.resize(n), s.height.resize(n);
  double best = -1e300, support = 0;
  int64_t leader = 0;
  for (int64_t i = 0; i < n; ++i) {
    const int64_t j = s.neighbors[i].index;
    const double *f = rules.frames + 9 * j, *q = rules.coefficients + 6 * j, radius = rules.radius[j];
    const Vec3 d = (1 / radius) * (x - load(rules.centers + 3 * j));
    double u = dot(d, load(f)), v = dot(d, load(f + 3)), h = dot(d, load(f + 6));
    const double sq = u * u + v * v, shrink = sq > 1 ? 1 / std::sqrt(sq) : 1;
    u *= shrink, v *= shrink;
    const double qu = q[1] + 2 * q[3] * u + q[4] * v, qv = q[2] + q[4] * u + 2 * q[5] * v;
    const double inv = 1 / std::sqrt(1 + qu * qu + qv * qv);
    const double r = (h - (q[0] + q[1] * u + q[2] * v + q[3] * u * u + q[4] * u * v + q[5] * v * v)) * inv;
    s.normal[i] = inv * (load(f + 6) - qu * load(f) - qv * load(f + 3));
    s.height[i] = r * radius;
    const double tolerance = std::max(rules.tolerance[j] / radius, 0.35), z = r / tolerance;
    const double membership = -2 * sq - 0.5 * z * z;
    support = std::max(support, std::exp(membership));
    s.log_weight[i] = membership + std::log(std::max(rules.confidence[j], 1e-6));
    if (s.log_weight[i] > best) best = s.log_weight[i], leader = i;
  }
  (void)leader;
  double sum = 0, total = 0;
  for (int64_t i = 0; i < n; ++i) {
    const double w = std::exp(s.log_weight[i] - best);
    sum += w * s.height[i], total += w;
  }
  value[0] = sum / std::max(total, 1e-300), value[1] = support;
}

}  // namespace sofnn
