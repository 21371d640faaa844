// SPDX-License-Identifier: MIT
// Signed distance at a place: local implicits of the nearest rules blended by fuzzy basis functions, eq. (9).
#pragma once
#include "rules.hpp"

namespace sofnn {

struct FieldScratch {
  Search neighbors;
  std::vector<double> log_weight, height, reach, share;
  std::vector<int> face;
  std::vector<Vec3> foot;
  std::vector<Vec3> normal;
};

// Rules whose normals differ by more than this cosine from the leading one belong to another sheet or face. The more
// noise there is in the leading rule, the more its neighbours may differ for no reason but noise.
inline double same_face(double relative_noise) { return std::min(std::max(0.9 - 5 * relative_noise, 0.2), 0.8); }
constexpr int kFaces = 3;

// A face counts when its best rule has at least this membership, relative to the best one (logarithm).
constexpr double kFaint = -3;

// Two faces meet in a convex edge when each lies behind the other: their solids intersect; else they unite.
// All pairs of rules vote by their memberships.
inline bool meet_convex(const FieldScratch& s, int a, int b) {
  double vote = 0;
  for (size_t i = 0; i < s.face.size(); ++i)
    for (size_t j = 0; s.face[i] == a && j < s.face.size(); ++j)
      if (s.face[j] == b) {
        const Vec3 d = s.foot[j] - s.foot[i];
        vote += s.share[i] * s.share[j] * (dot(d, s.normal[i]) - dot(d, s.normal[j]));
      }
  return vote < 0;
}

// Signed distance at x. The rules near x are gathered into at most three faces by their normals; each face blends
// its local implicits by fuzzy basis functions, eq. (9), and faces combine as solids (Ohtake et al. 2003, sharp features).
inline double evaluate_field(const RuleView& view, const TermView& terms, Vec3 x, int64_t k, FieldScratch& s) {
  view.tree.nearest_sorted(x, k, 1e300, s.neighbors);
  const int64_t n = s.neighbors.size();
  s.log_weight.resize(n), s.normal.resize(n), s.height.resize(n), s.face.assign(n, -1), s.reach.resize(n), s.foot.resize(n), s.share.resize(n);
  double nearest = -1e300;
  for (int64_t i = 0; i < n; ++i) {
    const int64_t j = s.neighbors[i].index;
    const Rule& rule = view.rules[j];
    const LocalImplicit local = local_implicit(view, j, x, terms);
    s.normal[i] = local.normal, s.height[i] = local.height;
    s.foot[i] = rule.center + (rule.radius * rule.coefficients[0]) * rule.frame.n;
    s.reach[i] = -2 * local.sq + rule.log_quality;
    nearest = std::max(nearest, s.reach[i]);
    const double z = local.height / std::max(rule.tolerance, 0.35 * rule.radius);
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
    const Rule& leading = view.rules[s.neighbors[best].index];
    const double same = same_face(leading.tolerance / leading.radius);
    double top = -1e300;
    for (int64_t i = 0; i < n; ++i)
      if (s.face[i] < 0 && dot(s.normal[i], s.normal[best]) >= same) s.face[i] = face, top = std::max(top, s.log_weight[i]);
    for (int64_t i = 0; i < n; ++i)
      if (s.face[i] == face) {
        const double w = std::exp(s.log_weight[i] - top);
        sum += w * s.height[i], total += w;
      }
    const double height = sum / total;
    if (face == 1)
      for (int64_t i = 0; i < n; ++i) s.share[i] = std::exp(s.reach[i] - nearest);
    if (face == 0)
      value = height;
    else
      value = meet_convex(s, 0, face) ? std::max(value, height) : std::min(value, height);
  }
  return value;
}

}  // namespace sofnn
