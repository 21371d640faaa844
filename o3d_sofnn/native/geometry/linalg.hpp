// SPDX-License-Identifier: MIT
// Small dense linear algebra: 3-vectors, symmetric 3x3 eigenvectors, Cholesky.
#pragma once
#include <cmath>
#include <utility>

namespace sofnn {

struct Vec3 {
  double x, y, z;
};
inline Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
inline Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
inline Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
inline double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(Vec3 a) { return std::sqrt(dot(a, a)); }
inline Vec3 unit(Vec3 a) {
  const double n = norm(a);
  return n > 0 && n < 1e300 ? (1 / n) * a : Vec3{0, 0, 1};
}
inline Vec3 load(const double* p) { return {p[0], p[1], p[2]}; }
inline void store(double* p, Vec3 a) { p[0] = a.x, p[1] = a.y, p[2] = a.z; }

// Right-handed frame (t1, t2, n) whose third axis is n; continuous but for n near -z.
struct Frame {
  Vec3 t1, t2, n;
};
inline Frame frame_of(Vec3 n) {
  const double s = n.z >= 0 ? 1.0 : -1.0, a = -1.0 / (s + n.z), b = n.x * n.y * a;
  return {{1 + s * n.x * n.x * a, s * b, -s * n.x}, {b, s + n.y * n.y * a, -n.y}, n};
}

// Part of a vector across another one, over its length, below which rounding decides where that part points.
constexpr double kParallel = 1e-6;

// Unit vector across a unit vector and another one: any across the former where the latter is parallel.
inline Vec3 across_both(Vec3 n, Vec3 other) {
  const Vec3 both = cross(other, n);
  return norm(both) > kParallel * norm(other) ? unit(both) : frame_of(n).t1;
}

// The frame whose first tangent is nearest to a direction: any frame where that is the direction of the normal.
inline Frame frame_along(Vec3 n, Vec3 direction) {
  const Vec3 rest = direction - dot(direction, n) * n;
  if (!(norm(rest) > kParallel * norm(direction))) return frame_of(n);
  const Vec3 t1 = unit(rest);
  return {t1, cross(n, t1), n};
}

// Eigenvectors of a symmetric 3x3 matrix (xx, xy, xz, yy, yz, zz) by cyclic Jacobi rotations;
// eigenvalues ascend, vectors are the rows of v.
inline void eigen_symmetric3(const double m[6], double value[3], Vec3 v[3]) {
  double a[3][3] = {{m[0], m[1], m[2]}, {m[1], m[3], m[4]}, {m[2], m[4], m[5]}};
  double q[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  for (int sweep = 0; sweep < 24; ++sweep) {
    const double off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
    const double diag = a[0][0] * a[0][0] + a[1][1] * a[1][1] + a[2][2] * a[2][2];
    if (off <= 1e-30 * diag || off == 0) break;
    for (int p = 0; p < 2; ++p)
      for (int r = p + 1; r < 3; ++r) {
        if (a[p][r] == 0) continue;
        const double theta = (a[r][r] - a[p][p]) / (2 * a[p][r]);
        const double t = (theta >= 0 ? 1 : -1) / (std::fabs(theta) + std::sqrt(theta * theta + 1));
        const double c = 1 / std::sqrt(t * t + 1), s = t * c;
        for (int k = 0; k < 3; ++k) {
          const double x = a[k][p], y = a[k][r];
          a[k][p] = c * x - s * y, a[k][r] = s * x + c * y;
        }
        for (int k = 0; k < 3; ++k) {
          const double x = a[p][k], y = a[r][k];
          a[p][k] = c * x - s * y, a[r][k] = s * x + c * y;
        }
        for (int k = 0; k < 3; ++k) {
          const double x = q[k][p], y = q[k][r];
          q[k][p] = c * x - s * y, q[k][r] = s * x + c * y;
        }
      }
  }
  int order[3] = {0, 1, 2};
  for (int i = 0; i < 2; ++i)
    for (int j = i + 1; j < 3; ++j)
      if (a[order[j]][order[j]] < a[order[i]][order[i]]) std::swap(order[i], order[j]);
  for (int i = 0; i < 3; ++i) {
    value[i] = a[order[i]][order[i]];
    v[i] = {q[0][order[i]], q[1][order[i]], q[2][order[i]]};
  }
}

// In-place Cholesky of the lower triangle of a (n x n, row-major, leading dimension ld); false if not positive.
inline bool cholesky(double* a, int n, int ld) {
  for (int j = 0; j < n; ++j) {
    double d = a[j * ld + j];
    for (int k = 0; k < j; ++k) d -= a[j * ld + k] * a[j * ld + k];
    if (!(d > 0)) return false;
    d = std::sqrt(d);
    a[j * ld + j] = d;
    for (int i = j + 1; i < n; ++i) {
      double s = a[i * ld + j];
      for (int k = 0; k < j; ++k) s -= a[i * ld + k] * a[j * ld + k];
      a[i * ld + j] = s / d;
    }
  }
  return true;
}

inline void cholesky_solve(const double* a, int n, int ld, double* b) {
  for (int i = 0; i < n; ++i) {
    double s = b[i];
    for (int k = 0; k < i; ++k) s -= a[i * ld + k] * b[k];
    b[i] = s / a[i * ld + i];
  }
  for (int i = n - 1; i >= 0; --i) {
    double s = b[i];
    for (int k = i + 1; k < n; ++k) s -= a[k * ld + i] * b[k];
    b[i] = s / a[i * ld + i];
  }
}

}  // namespace sofnn
