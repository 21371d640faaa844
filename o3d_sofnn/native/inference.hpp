// SPDX-License-Identifier: MIT
// Normal at a point by product inference over the nearest rules, eq. (7) and (9).
#pragma once
#include "kdtree.hpp"

namespace sofnn {

struct RuleView {
  const double *centers, *frames, *coefficients, *radius, *tolerance, *quality;
  const double* rbf = nullptr;  // (rules, stride, 4): centre and weight of each term of the local surfaces
  const int64_t* terms = nullptr;
  int64_t stride = 0;
};

struct InferenceScratch {
  std::vector<Neighbor> neighbors;
  std::vector<double> log_weight, height, reach;
  std::vector<int> face;
  std::vector<Vec3> foot;
  std::vector<Vec3> normal;
};

// Membership of x in a rule: Gaussian in the tangent plane (half the radius wide) times Gaussian in the residual
// to the rule's quadric. info: agreement of the contributing rules, residual of the best rule.
inline void infer_normal(const KdTree& tree, const RuleView& rules, Vec3 x, int64_t k, InferenceScratch& s,
                         double* out, double* info) {
  tree.nearest(x, k, 1e300, s.neighbors);
  const int64_t n = static_cast<int64_t>(s.neighbors.size());
  s.log_weight.resize(n), s.normal.resize(n);
  double best = -1e300, residual = 0;
  for (int64_t i = 0; i < n; ++i) {
    const int64_t j = s.neighbors[i].index;
    const double *f = rules.frames + 9 * j, *q = rules.coefficients + 6 * j, radius = rules.radius[j];
    const Vec3 d = (1 / radius) * (x - load(rules.centers + 3 * j));
    double u = dot(d, load(f)), v = dot(d, load(f + 3)), h = dot(d, load(f + 6));
    const double sq = u * u + v * v, shrink = sq > 1 ? 1 / std::sqrt(sq) : 1;
    u *= shrink, v *= shrink;  // no extrapolation of the quadric beyond its own data
    const double qu = q[1] + 2 * q[3] * u + q[4] * v, qv = q[2] + q[4] * u + 2 * q[5] * v;
    const double inv = 1 / std::sqrt(1 + qu * qu + qv * qv);
    const double r = (h - (q[0] + q[1] * u + q[2] * v + q[3] * u * u + q[4] * u * v + q[5] * v * v)) * inv * radius;
    s.normal[i] = inv * (load(f + 6) - qu * load(f) - qv * load(f + 3));
    const double z = r / rules.tolerance[j];
    s.log_weight[i] = -2 * sq - 0.5 * z * z + std::log(std::max(rules.quality[j], 1e-12));
    if (s.log_weight[i] > best) best = s.log_weight[i], residual = r;
  }
  Vec3 sum{0, 0, 0};
  double total = 0;
  for (int64_t i = 0; i < n; ++i) {
    const double w = std::exp(s.log_weight[i] - best);  // Eq. (9), safe far from every rule
    sum = sum + w * s.normal[i], total += w;
  }
  if (norm(sum) < 1e-6 * total)  // the rules cancel: the nearest in membership decides
    for (int64_t i = 0; i < n; ++i)
      if (s.log_weight[i] == best) sum = total * s.normal[i];
  store(out, unit(sum));  // Eq. (7)
  info[0] = std::min(norm(sum) / std::max(total, 1e-300), 1.0), info[1] = residual;
}

}  // namespace sofnn
