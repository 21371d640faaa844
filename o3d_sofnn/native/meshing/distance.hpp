// SPDX-License-Identifier: MIT
// Distances of places from the triangles of a mesh.
#pragma once
#include "meshing/triangle_tree.hpp"

namespace sofnn {

// By the region that a place lies in: a corner, an edge, or the triangle (Ericson, "Real-time collision detection",
// 2005, section 5.1.5).
inline double squared_distance(Vec3 x, Vec3 a, Vec3 b, Vec3 c) {
  const auto squared = [](Vec3 v) { return dot(v, v); };
  const Vec3 ab = b - a, ac = c - a, ax = x - a, bx = x - b, cx = x - c;
  const double d1 = dot(ab, ax), d2 = dot(ac, ax), d3 = dot(ab, bx), d4 = dot(ac, bx), d5 = dot(ab, cx), d6 = dot(ac, cx);
  if (d1 <= 0 && d2 <= 0) return squared(ax);
  if (d3 >= 0 && d4 <= d3) return squared(bx);
  if (d6 >= 0 && d5 <= d6) return squared(cx);
  const double of_c = d1 * d4 - d3 * d2, of_b = d5 * d2 - d1 * d6, of_a = d3 * d6 - d5 * d4;
  if (of_c <= 0 && d1 >= 0 && d3 <= 0) return squared(ax - (d1 / (d1 - d3)) * ab);
  if (of_b <= 0 && d2 >= 0 && d6 <= 0) return squared(ax - (d2 / (d2 - d6)) * ac);
  if (of_a <= 0 && d4 >= d3 && d5 >= d6) return squared(bx - ((d4 - d3) / ((d4 - d3) + (d5 - d6))) * (c - b));
  const double share = 1 / (of_a + of_b + of_c);
  return squared(ax - (share * of_b) * ab - (share * of_c) * ac);
}

struct Nearest {
  std::vector<double> distance;
  std::vector<int64_t> triangle;  // of equally near ones the first
};

inline Nearest nearest_triangles(const MeshView& mesh, const double* x, int64_t n, int threads) {
  const TriangleTree tree(mesh, threads);
  Nearest found{std::vector<double>(n, std::numeric_limits<double>::infinity()), std::vector<int64_t>(n, mesh.n_triangles)};
  parallel_for(n, 256, threads, [&](int64_t first, int64_t last) {
    for (int64_t i = first; i < last; ++i) {
      const Vec3 place = load(x + 3 * i);
      double least = found.distance[i];
      int64_t best = mesh.n_triangles;
      tree.by_distance(place, least, [&](int32_t t) {
        const int32_t* v = mesh.triangles + 3 * int64_t{t};
        const double squared = squared_distance(place, mesh.vertex(v[0]), mesh.vertex(v[1]), mesh.vertex(v[2]));
        if (squared < least || (squared == least && t < best)) least = squared, best = t;
      });
      found.distance[i] = std::sqrt(least), found.triangle[i] = best;
    }
  });
  return found;
}

}  // namespace sofnn
