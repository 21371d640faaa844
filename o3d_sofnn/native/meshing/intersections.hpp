// SPDX-License-Identifier: MIT
// Triangles of a mesh that cut, touch or cover others, but for the corners and edges that neighbours share. What is
// apart has a plane between (Gottschalk, Lin and Manocha, "OBBTree", 1996): a pair counts as apart only where one is
// found, so that rounding never hides an intersection.
#pragma once
#include <algorithm>
#include <cstdint>

#include "geometry/linalg.hpp"

namespace sofnn {

// Smallest gap relative to the larger triangle, or sine of an angle between neighbours: closer triangles touch. It is
// wide enough for coordinates rounded to 32 bits in a mesh a thousand edges across, and too small to be seen.
constexpr double kTouch = 1e-4;
constexpr double kTouch2 = kTouch * kTouch;

// Whether two triangles have a gap along an axis.
inline bool gap_along(Vec3 axis, const Vec3* a, const Vec3* b, double size2) {
  double al = dot(axis, a[0]), ah = al, bl = dot(axis, b[0]), bh = bl;
  for (int k = 1; k < 3; ++k) {
    const double x = dot(axis, a[k]), y = dot(axis, b[k]);
    al = std::min(al, x), ah = std::max(ah, x), bl = std::min(bl, y), bh = std::max(bh, y);
  }
  const double gap = std::max(al - bh, bl - ah);
  return gap > 0 && gap * gap > kTouch2 * dot(axis, axis) * size2;
}

// Triangles without a common corner.
inline bool strangers_meet(const Vec3* p, const Vec3* q) {
  Vec3 a[3], b[3], e[3], f[3];
  double size2 = 0;
  for (int k = 0; k < 3; ++k) {  // rounding is relative to the pair, not to its place
    a[k] = p[k] - p[0], b[k] = q[k] - p[0];
    e[k] = p[(k + 1) % 3] - p[k], f[k] = q[(k + 1) % 3] - q[k];
    size2 = std::max({size2, dot(e[k], e[k]), dot(f[k], f[k])});
  }
  const Vec3 n = cross(e[0], e[1]), m = cross(f[0], f[1]);
  if (gap_along(n, a, b, size2) || gap_along(m, a, b, size2)) return false;
  for (int k = 0; k < 3; ++k)
    if (gap_along(cross(n, e[k]), a, b, size2) || gap_along(cross(m, f[k]), a, b, size2)) return false;
  for (int k = 0; k < 3; ++k)
    for (int j = 0; j < 3; ++j)
      if (gap_along(cross(e[k], f[j]), a, b, size2)) return false;
  return true;
}

// The side of a plane through the common corner that a direction points to: 1, -1, or 0 along it.
inline int side_of(Vec3 axis, Vec3 way) {
  const double height = dot(axis, way);
  return height * height <= kTouch2 * dot(axis, axis) * dot(way, way) ? 0 : height > 0 ? 1 : -1;
}

// The angle between two edges of a triangle.
struct Angle {
  Vec3 way[2];

  Vec3 normal() const { return cross(way[0], way[1]); }
  // From an edge into the angle, upright on it.
  Vec3 inward(int k) const { return k == 0 ? cross(normal(), way[0]) : cross(way[1], normal()); }
  // Whether a direction in its plane lies outside of it.
  bool leaves_out(Vec3 direction) const { return side_of(inward(0), direction) < 0 || side_of(inward(1), direction) < 0; }

  // Whether the other one lies on one side of its plane, and does not touch it there.
  bool plane_leaves_out(const Angle& o) const {
    const int a = side_of(normal(), o.way[0]), b = side_of(normal(), o.way[1]);
    return a * b > 0 || (a != 0 && b == 0 && leaves_out(o.way[1])) || (a == 0 && b != 0 && leaves_out(o.way[0]));
  }

  // Whether the other one lies beyond the plane through an edge, upright on its own.
  bool edge_leaves_out(int k, const Angle& o) const {
    const int a = side_of(inward(k), o.way[0]), b = side_of(inward(k), o.way[1]);
    return a <= 0 && b <= 0 && a + b < 0 && (a < 0 || parted(way[k], o.way[0])) && (b < 0 || parted(way[k], o.way[1]));
  }

  static bool parted(Vec3 a, Vec3 b) {
    const Vec3 turn = cross(a, b);
    return dot(a, b) < 0 || dot(turn, turn) > kTouch2 * dot(a, a) * dot(b, b);
  }
};

// Whether the plane across the way from the middle of one angle to that of the other divides them, as it does for most.
inline bool divided(const Angle& u, const Angle& w) {
  const Vec3 a = u.way[0] + u.way[1], b = w.way[0] + w.way[1], axis = dot(b, b) * a - dot(a, a) * b;
  const double least = std::min(std::min(dot(axis, u.way[0]), dot(axis, u.way[1])), -std::max(dot(axis, w.way[0]), dot(axis, w.way[1])));
  const double size2 = dot(u.way[0], u.way[0]) + dot(u.way[1], u.way[1]) + dot(w.way[0], w.way[0]) + dot(w.way[1], w.way[1]);
  return least > 0 && least * least > kTouch2 * dot(axis, axis) * size2;
}

// Triangles with one common corner: they have nothing else in common where a plane through it divides their angles.
inline bool corners_meet(const Angle& u, const Angle& w) {
  if (divided(u, w)) return false;
  for (int k = 0; k < 2; ++k)
    if (u.edge_leaves_out(k, w) || w.edge_leaves_out(k, u)) return false;
  if (u.plane_leaves_out(w) || w.plane_leaves_out(u)) return false;
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 2; ++j) {
      const Vec3 axis = cross(u.way[i], w.way[j]);
      if (Angle::parted(u.way[i], w.way[j]) && side_of(axis, u.way[1 - i]) * side_of(axis, w.way[1 - j]) < 0) return false;
    }
  return true;
}

// Triangles on both sides of an edge: they cover each other where they are folded flat.
inline bool folded(Vec3 edge, Vec3 u, Vec3 w) {
  const Vec3 n = cross(edge, u), m = cross(edge, w), turn = cross(n, m);
  return dot(n, m) > 0 && dot(turn, turn) <= kTouch2 * dot(n, n) * dot(m, m);
}

inline bool triangles_meet(const double* vertices, const int32_t* s, const int32_t* t) {
  const auto at = [&](int32_t i) { return load(vertices + 3 * int64_t{i}); };
  unsigned equal = 0;  // a bit for each pair of corners
  for (int k = 0; k < 9; ++k) equal |= static_cast<unsigned>(s[k / 3] == t[k % 3]) << k;
  if (equal == 0) {
    const Vec3 p[3] = {at(s[0]), at(s[1]), at(s[2])}, q[3] = {at(t[0]), at(t[1]), at(t[2])};
    return strangers_meet(p, q);
  }
  const auto first = [](unsigned bits) {
    int k = 0;
    while (!(bits >> k & 1)) ++k;
    return k;
  };
  const int k = first(equal), own = k / 3, other = k % 3;
  const Vec3 corner = at(s[own]);
  equal &= equal - 1;
  if (equal == 0) {
    const auto angle = [&](const int32_t* t, int k) {
      return Angle{{at(t[(k + 1) % 3]) - corner, at(t[(k + 2) % 3]) - corner}};
    };
    return corners_meet(angle(s, own), angle(t, other));
  }
  const int next = first(equal);
  // The same triangle, or one that names a vertex twice.
  if ((equal & (equal - 1)) != 0 || next / 3 == own || next % 3 == other) return true;
  return folded(at(s[next / 3]) - corner, at(s[3 - own - next / 3]) - corner, at(t[3 - other - next % 3]) - corner);
}

}  // namespace sofnn
