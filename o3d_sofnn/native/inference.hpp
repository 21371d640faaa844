// SPDX-License-Identifier: MIT
// Normal at a point by product inference over the nearest rules, eq. (7) and (9).
#pragma once
#include "rlps.hpp"

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

// What one rule says at x: squared tangential distance over its radius, signed distance, normal of its quadric.
struct LocalImplicit {
  double sq, height;
  Vec3 normal;
};

inline LocalImplicit local_implicit(const RuleView& rules, int64_t j, Vec3 x) {
  const double *f = rules.frames + 9 * j, *q = rules.coefficients + 6 * j, radius = rules.radius[j];
  const Vec3 d = (1 / radius) * (x - load(rules.centers + 3 * j));
  double u = dot(d, load(f)), v = dot(d, load(f + 3)), h = dot(d, load(f + 6));
  const double sq = u * u + v * v, shrink = sq > 1 ? 1 / std::sqrt(sq) : 1;
  u *= shrink, v *= shrink;  // no extrapolation of the quadric beyond its own data
  const double qu = q[1] + 2 * q[3] * u + q[4] * v, qv = q[2] + q[4] * u + 2 * q[5] * v;
  const double inv = 1 / std::sqrt(1 + qu * qu + qv * qv);
  double height = quadric_height(q, u, v);
  if (rules.terms) height += rbf_terms(rules.rbf + 4 * rules.stride * j, rules.terms[j], u, v, h);
  return {sq, (h - height) * inv * radius, inv * (load(f + 6) - qu * load(f) - qv * load(f + 3))};
}

// Memberships of x in its nearest rules: a Gaussian in the tangent plane (half the radius wide), a Gaussian in the
// residual to the rule's quadric, and the rule's quality. Returns the place of the largest one.
inline int64_t memberships(const KdTree& tree, const RuleView& rules, Vec3 x, int64_t k, InferenceScratch& s) {
  tree.nearest(x, k, 1e300, s.neighbors);
  const int64_t n = static_cast<int64_t>(s.neighbors.size());
  s.log_weight.resize(n), s.normal.resize(n), s.height.resize(n);
  int64_t best = 0;
  for (int64_t i = 0; i < n; ++i) {
    const int64_t j = s.neighbors[i].index;
    const LocalImplicit f = local_implicit(rules, j, x);
    const double z = f.height / rules.tolerance[j];
    s.normal[i] = f.normal, s.height[i] = f.height;
    s.log_weight[i] = -2 * f.sq - 0.5 * z * z + std::log(std::max(rules.quality[j], 1e-12));
    if (s.log_weight[i] > s.log_weight[best]) best = i;
  }
  return best;
}

// info: agreement of the contributing rules, residual of the best rule.
inline void infer_normal(const KdTree& tree, const RuleView& rules, Vec3 x, int64_t k, InferenceScratch& s,
                         double* out, double* info) {
  const int64_t best = memberships(tree, rules, x, k, s);
  Vec3 sum{0, 0, 0};
  double total = 0;
  for (size_t i = 0; i < s.neighbors.size(); ++i) {
    const double w = std::exp(s.log_weight[i] - s.log_weight[best]);  // Eq. (9), safe far from every rule
    sum = sum + w * s.normal[i], total += w;
  }
  if (norm(sum) < 1e-6 * total) sum = total * s.normal[best];  // the rules cancel
  store(out, unit(sum));  // Eq. (7)
  info[0] = std::min(norm(sum) / std::max(total, 1e-300), 1.0), info[1] = s.height[best];
}

}  // namespace sofnn
