// SPDX-License-Identifier: MIT
// Which points a unit of Algorithm 2 has, and which points of other faces bound it.
#pragma once
#include "implicit/rlps.hpp"
#include "rules/rules.hpp"

namespace sofnn {

constexpr double kSameSide = 0.5;  // least cosine between a unit's normal and those of its points
// Points of other faces bound a unit as far out as its function is used, over its radius, and in their number.
constexpr double kBoundReach = 1.25;
constexpr int kBoundCount = 3;
// Least distance of the unit's centre from the tangent plane of such a point, over their distance: it lies behind or
// in front of that face for certain.
constexpr double kApart = 0.2;

// Gather the points of a unit of n nearest points, of which the first own ones decide. Faces combine as solids do: the
// points of one face lie within the other where they meet in a convex edge, outside of it where they meet in a concave one.
inline void unit_points(const KdTree& tree, const double* points, const double* normals, const Rule& rule, int64_t n,
                        int64_t own, Search& near, std::vector<UnitPoint>& unit) {
  const Frame& f = rule.frame;
  const double *q = rule.coefficients, r = rule.radius;
  const Vec3 side = f.n - q[1] * f.t1 - q[2] * f.t2;
  tree.nearest(rule.center, kBoundCount * n, kBoundReach * kBoundReach * r * r, near);
  const int64_t sizes[] = {own, n};
  double farthest[2];
  near.nest(sizes, 2, farthest);
  unit.clear();
  bool any = false;  // without points on the side of the unit there is nothing that others could bound
  for (int64_t rank = 0; rank < static_cast<int64_t>(near.size()); ++rank) {
    const int64_t j = near[rank].index;
    const Vec3 d = (1 / r) * (load(points + 3 * j) - rule.center), facing = load(normals + 3 * j);
    double u = dot(d, f.t1), v = dot(d, f.t2);
    int bound = 0;
    if (dot(facing, side) < kSameSide * norm(side)) {
      const double behind = dot(d, facing);
      if (std::fabs(behind) < kApart * norm(d)) continue;
      bound = behind > 0 ? 1 : -1;
      const double reach = rule.stretch * u * u + v * v / rule.stretch;
      const double inside = 1 / std::sqrt(std::max(reach, 1.0));  // as in the field
      u *= inside, v *= inside;
    } else if (rank >= n || near[rank].sq_dist > r * r) {
      continue;
    }
    any = any || bound == 0;
    unit.push_back({u, v, dot(d, f.n), bound, rank < own || bound != 0});
  }
  if (!any) unit.clear();
}

}  // namespace sofnn
