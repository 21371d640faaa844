// SPDX-License-Identifier: MIT
// Signed distance at a place: local implicits of the nearest rules blended by fuzzy basis functions, eq. (9).
#pragma once
#include "inference.hpp"
#include "rlps.hpp"

namespace sofnn {

// Rules whose normals differ by more than this cosine from the leading one belong to another sheet or face. The more
// noise there is in the leading rule, the more its neighbours may differ for no reason but noise.
inline double same_face(double relative_noise) { return std::min(std::max(0.9 - 5 * relative_noise, 0.2), 0.8); }
constexpr int kFaces = 3;

// A face counts when its best rule has at least this membership, relative to the best one (logarithm).
constexpr double kFaint = -3;

// Two faces meet in a convex edge when each lies behind the other: their solids intersect; else they unite.
// All pairs of rules vote by their memberships.
inline bool meet_convex(const InferenceScratch& s, int a, int b, double best) {
  double vote = 0;
  for (size_t i = 0; i < s.face.size(); ++i)
    for (size_t j = 0; s.face[i] == a && j < s.face.size(); ++j)
      if (s.face[j] == b) {
        const Vec3 d = s.foot[j] - s.foot[i];
        vote += std::exp(s.reach[i] + s.reach[j] - 2 * best) * (dot(d, s.normal[i]) - dot(d, s.normal[j]));
      }
  return vote < 0;
}

// Signed distance at x. The rules near x are gathered into at most three faces by their normals; each face blends
// its local implicits by fuzzy basis functions, eq. (9), and faces combine as solids (Ohtake et al. 2003, sharp features).
inline double evaluate_field(const KdTree& tree, const RuleView& rules, Vec3 x, int64_t k, InferenceScratch& s) {
  tree.nearest(x, k, 1e300, s.neighbors);
  const int64_t n = static_cast<int64_t>(s.neighbors.size());
  s.log_weight.resize(n), s.normal.resize(n), s.height.resize(n), s.face.assign(n, -1), s.reach.resize(n), s.foot.resize(n);
  double nearest = -1e300;
  for (int64_t i = 0; i < n; ++i) {
    const int64_t j = s.neighbors[i].index;
    const double *f = rules.frames + 9 * j, *q = rules.coefficients + 6 * j, radius = rules.radius[j];
    const Vec3 d = (1 / radius) * (x - load(rules.centers + 3 * j));
    double u = dot(d, load(f)), v = dot(d, load(f + 3)), h = dot(d, load(f + 6));
    const double sq = u * u + v * v, shrink = sq > 1 ? 1 / std::sqrt(sq) : 1;
    u *= shrink, v *= shrink;
    const double qu = q[1] + 2 * q[3] * u + q[4] * v, qv = q[2] + q[4] * u + 2 * q[5] * v;
    const double inv = 1 / std::sqrt(1 + qu * qu + qv * qv);
    double height = quadric_height(q, u, v);
    if (rules.terms && rules.terms[j] > 0) height += rbf_terms(rules.rbf + 4 * rules.stride * j, rules.terms[j], u, v, h);
    const double r = (h - height) * inv;
    s.normal[i] = inv * (load(f + 6) - qu * load(f) - qv * load(f + 3));
    s.foot[i] = load(rules.centers + 3 * j) + (radius * q[0]) * load(f + 6);
    s.height[i] = r * radius;
    s.reach[i] = -2 * sq + std::log(std::max(rules.quality[j], 1e-300));
    nearest = std::max(nearest, s.reach[i]);
    const double z = r / std::max(rules.tolerance[j] / radius, 0.35);
    s.log_weight[i] = s.reach[i] - 0.5 * z * z;
  }
  double value = 0;
  for (int face = 0; face < kFaces; ++face) {
    int64_t best = -1;
    for (int64_t i = 0; i < n; ++i)
      if (s.face[i] < 0 && (face == 0 || s.reach[i] > nearest + kFaint) && (best < 0 || s.log_weight[i] > s.log_weight[best]))
        best = i;
    if (best < 0) break;
    double sum = 0, total = 0;
    const int64_t rule = s.neighbors[best].index;
    const double same = same_face(rules.tolerance[rule] / rules.radius[rule]);
    for (int64_t i = 0; i < n; ++i) {
      if (s.face[i] >= 0 || dot(s.normal[i], s.normal[best]) < same) continue;
      const double w = std::exp(s.log_weight[i] - s.log_weight[best]);
      sum += w * s.height[i], total += w;
      s.face[i] = face;
    }
    const double height = sum / total;
    if (face == 0)
      value = height;
    else
      value = meet_convex(s, 0, face, nearest) ? std::max(value, height) : std::min(value, height);
  }
  return value;
}

}  // namespace sofnn
