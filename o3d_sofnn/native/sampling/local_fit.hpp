// SPDX-License-Identifier: MIT
// Plane and quadric fits around given centres, several neighbourhood sizes at once (Algorithm 1, steps 3 and 5).
#pragma once
#include "geometry/kdtree.hpp"

namespace sofnn {

// One fit: a frame at the foot point of the centre and heights h = c0 + c1 u + c2 v + c3 u^2 + c4 uv + c5 v^2
// in that frame, lengths in units of the radius. residual: root mean square. support:
// share of the neighbourhood that faces the side of the fit.
struct LocalFit {
  Vec3 normal;
  double residual, radius, surface_variation, support;
  double coefficients[6];
  Frame frame;
};

// Points of one fit, a column each: offsets from the centre, factor of the weight, coordinates in the frame of the
// fit, its weights, residuals.
struct FitScratch {
  Search neighbors;
  std::vector<double> x, y, z, factor, u, v, h, weight, robust, residual, target;

  void resize(int64_t n) {
    for (auto* column : {&x, &y, &z, &factor, &u, &v, &h, &weight, &robust, &residual, &target})
      if (static_cast<int64_t>(column->size()) < n) column->resize(n);
  }
};

// How flat the weight by angle is for small angles, over the ratio of the residual width to the radius: the noisier
// the data, the larger the angle that noise alone causes.
constexpr double kNoisyNormals = 5;

// Columns of the points around a centre. With oriented normals of the points and a side, points that face away from
// the side get no weight, those at an angle less of it; the noisier they are, the larger the angle may be.
inline void load_points(const double* points, const double* normals, const double* side, double robust, Vec3 center,
                        FitScratch& s) {
  const int64_t n = s.neighbors.size();
  s.resize(n);
  double sq_radius = 0;
  for (int64_t i = 0; i < n; ++i) {
    const double* p = points + 3 * s.neighbors[i].index;
    s.x[i] = p[0] - center.x, s.y[i] = p[1] - center.y, s.z[i] = p[2] - center.z;
    sq_radius = std::max(sq_radius, s.neighbors[i].sq_dist);
  }
  const double gain = 1 + kNoisyNormals * robust / std::max(std::sqrt(sq_radius), 1e-300);
  for (int64_t i = 0; i < n; ++i) {
    const double agree = normals ? std::max(dot(load(normals + 3 * s.neighbors[i].index), load(side)), 0.0) : 0.0;
    const double factor = std::min(gain * agree, 1.0);
    s.factor[i] = normals ? factor * factor + 1e-6 : 1.0;
  }
}

// An elliptical neighbourhood: so many times narrower along one tangent and wider along the other than a circle of the
// same area has the root of it.
struct Ellipse {
  Vec3 across{0, 0, 0}, along{0, 0, 0};
  double stretch = 1;
};

// Weights that fall to zero at the edge of the ellipse, and their moments up to second order; lengths in radii.
SOFNN_CLONES inline void weigh(const double* SOFNN_RESTRICT x, const double* SOFNN_RESTRICT y,
                               const double* SOFNN_RESTRICT z, const double* SOFNN_RESTRICT factor, int64_t n,
                               double inv, const Ellipse& ellipse, double* SOFNN_RESTRICT weight,
                               double* SOFNN_RESTRICT moments, double* SOFNN_RESTRICT share) {
  const Vec3 s1 = ellipse.across, s2 = ellipse.along;
  const double more = ellipse.stretch - 1, less = 1 - 1 / ellipse.stretch;
  double everything = 0, s = 0, sx = 0, sy = 0, sz = 0, xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  for (int64_t i = 0; i < n; ++i) {
    const double a = inv * x[i], b = inv * y[i], c = inv * z[i];
    const double u = a * s1.x + b * s1.y + c * s1.z, v = a * s2.x + b * s2.y + c * s2.z;
    const double rest = 1 - (a * a + b * b + c * c + more * u * u - less * v * v);
    const double near = rest > 0 ? rest : 0, w = near * factor[i];
    everything += near;
    const double wa = w * a, wb = w * b, wc = w * c;
    weight[i] = w;
    s += w, sx += wa, sy += wb, sz += wc;
    xx += wa * a, xy += wa * b, xz += wa * c, yy += wb * b, yz += wb * c, zz += wc * c;
  }
  const double all[10] = {s, sx, sy, sz, xx, xy, xz, yy, yz, zz};
  for (int i = 0; i < 10; ++i) moments[i] = all[i];
  *share = s / std::max(everything, 1e-300);
}

SOFNN_CLONES inline void turn(const double* SOFNN_RESTRICT x, const double* SOFNN_RESTRICT y,
                              const double* SOFNN_RESTRICT z, int64_t n, const Frame& scaled, double* SOFNN_RESTRICT u,
                              double* SOFNN_RESTRICT v, double* SOFNN_RESTRICT h) {
  const Frame f = scaled;
  for (int64_t i = 0; i < n; ++i) {
    u[i] = f.t1.x * x[i] + f.t1.y * y[i] + f.t1.z * z[i];
    v[i] = f.t2.x * x[i] + f.t2.y * y[i] + f.t2.z * z[i];
    h[i] = f.n.x * x[i] + f.n.y * y[i] + f.n.z * z[i];
  }
}

// Weights in the residual, exp(exponent r^2).
SOFNN_CLONES inline void weigh_residuals(const double* SOFNN_RESTRICT weight, const double* SOFNN_RESTRICT residual,
                                         int64_t n, double exponent, double* SOFNN_RESTRICT out) {
  for (int64_t i = 0; i < n; ++i) out[i] = weight[i] * exp_negative(exponent * residual[i] * residual[i]);
}

// Sums of the normal equations: w u^i v^j for i + j <= 4, then w h times the six terms of the quadric, then w^2.
struct QuadricSums {
  double moments[15], right[6], weight2;
};

SOFNN_CLONES inline void sum_quadric(const double* SOFNN_RESTRICT us, const double* SOFNN_RESTRICT vs,
                                     const double* SOFNN_RESTRICT hs, const double* SOFNN_RESTRICT ws, int64_t n,
                                     QuadricSums* SOFNN_RESTRICT out) {
  double m0 = 0, m1 = 0, m2 = 0, m3 = 0, m4 = 0, m5 = 0, m6 = 0, m7 = 0, m8 = 0, m9 = 0, m10 = 0, m11 = 0, m12 = 0,
         m13 = 0, m14 = 0, r0 = 0, r1 = 0, r2 = 0, r3 = 0, r4 = 0, r5 = 0, w2 = 0;
  for (int64_t i = 0; i < n; ++i) {
    const double u = us[i], v = vs[i], h = hs[i], w = ws[i];
    const double wu = w * u, wv = w * v, wh = w * h, uu = u * u, uv = u * v, vv = v * v;
    const double wuu = w * uu, wuv = w * uv, wvv = w * vv;
    m0 += w, m1 += wu, m2 += wv, m3 += wuu, m4 += wuv, m5 += wvv;
    m6 += wuu * u, m7 += wuu * v, m8 += wvv * u, m9 += wvv * v;
    m10 += wuu * uu, m11 += wuu * uv, m12 += wuu * vv, m13 += wvv * uv, m14 += wvv * vv;
    r0 += wh, r1 += wh * u, r2 += wh * v, r3 += wh * uu, r4 += wh * uv, r5 += wh * vv;
    w2 += w * w;
  }
  *out = {{m0, m1, m2, m3, m4, m5, m6, m7, m8, m9, m10, m11, m12, m13, m14}, {r0, r1, r2, r3, r4, r5}, w2};
}

// Residuals to a quadric, and the sum of their weighted squares.
SOFNN_CLONES inline double sum_residuals(const double* SOFNN_RESTRICT us, const double* SOFNN_RESTRICT vs,
                                         const double* SOFNN_RESTRICT hs, const double* SOFNN_RESTRICT ws, int64_t n,
                                         const double* q, double* SOFNN_RESTRICT residual) {
  const double q0 = q[0], q1 = q[1], q2 = q[2], q3 = q[3], q4 = q[4], q5 = q[5];
  double sum = 0;
  for (int64_t i = 0; i < n; ++i) {
    const double u = us[i], v = vs[i];
    const double r = hs[i] - (q0 + u * (q1 + q3 * u + q4 * v) + v * (q2 + q5 * v));
    residual[i] = r;
    sum += ws[i] * r * r;
  }
  return sum;
}

// Cholesky factor of the normal equations with a small penalty that leaves the plane free.
inline bool factor_quadric(const QuadricSums& sums, double* a) {
  const double* m = sums.moments;
  const double full[36] = {m[0], 0,    0,     0,     0,     0,   m[1], m[3],  0,     0,     0,     0,
                           m[2], m[4], m[5],  0,     0,     0,   m[3], m[6],  m[7],  m[10], 0,     0,
                           m[4], m[7], m[8],  m[11], m[12], 0,   m[5], m[8],  m[9],  m[12], m[13], m[14]};
  std::copy(full, full + 36, a);
  const double ridge = 1e-9 * std::max(m[0], 1e-300);
  a[0] += ridge * 1e-3;
  for (int p = 1; p < 6; ++p) a[7 * p] += ridge + (p > 2 ? 1e-4 * m[0] : 0);
  return cholesky(a, 6, 6);
}

// Replaces a parabola by the arc of a circle with the same curvature: along every direction of the tangent plane the surface
// is taken as a circle, so that tubes and spheres have no error of shape. The arc ends before it turns vertical.
constexpr double kSteepest = 0.75;

// Height of the arc over that of the parabola (1 at the centre), from the height p of the parabola at a squared distance.
SOFNN_INLINE double arc_over_parabola(double p, double sq) {
  const double steep = 4 * p * p / (sq > 1e-30 ? sq : 1e-30);
  return 2 / (1 + std::sqrt(1 - (steep < kSteepest ? steep : kSteepest)));
}

SOFNN_CLONES inline void subtract_arcs(const double* SOFNN_RESTRICT us, const double* SOFNN_RESTRICT vs,
                                       const double* SOFNN_RESTRICT hs, int64_t n, const double* q,
                                       double* SOFNN_RESTRICT out) {
  const double q3 = q[3], q4 = q[4], q5 = q[5];
  for (int64_t i = 0; i < n; ++i) {
    const double u = us[i], v = vs[i], p = u * (q3 * u + q4 * v) + q5 * v * v;
    out[i] = hs[i] - p * (arc_over_parabola(p, u * u + v * v) - 1);
  }
}

// Weighted quadric over the first k points of s, the farthest of which is known. robust > 0 weights residuals by
// exp(-r^2 / (2 robust^2)), iterated.
inline LocalFit fit_quadric(int64_t k, double sq_radius, const Ellipse& ellipse, double robust, int iterations, FitScratch& s) {
  LocalFit fit{};
  const double radius = std::sqrt(sq_radius / ellipse.stretch) * 1.1, inv = radius > 0 ? 1 / radius : 0;
  fit.radius = radius;

  double m[10], value[3];
  weigh(s.x.data(), s.y.data(), s.z.data(), s.factor.data(), k, inv, ellipse, s.weight.data(), m, &fit.support);
  const double total = std::max(m[0], 1e-300), mean[3] = {m[1] / total, m[2] / total, m[3] / total};
  const double covariance[6] = {m[4] / total - mean[0] * mean[0], m[5] / total - mean[0] * mean[1],
                                m[6] / total - mean[0] * mean[2], m[7] / total - mean[1] * mean[1],
                                m[8] / total - mean[1] * mean[2], m[9] / total - mean[2] * mean[2]};
  Vec3 axis[3];
  eigen_symmetric3(covariance, value, axis);
  fit.surface_variation = value[0] / std::max(value[0] + value[1] + value[2], 1e-300);
  fit.frame = ellipse.stretch > 1 ? frame_along(unit(axis[0]), ellipse.across) : frame_of(unit(axis[0]));
  const Frame scaled{inv * fit.frame.t1, inv * fit.frame.t2, inv * fit.frame.n};
  turn(s.x.data(), s.y.data(), s.z.data(), k, scaled, s.u.data(), s.v.data(), s.h.data());

  const double *weight = s.weight.data(), *height = s.h.data();
  double factor[36];
  for (int pass = 0; pass <= iterations; ++pass) {
    QuadricSums sums;
    sum_quadric(s.u.data(), s.v.data(), height, weight, k, &sums);
    if (!(sums.moments[0] > 0) || !factor_quadric(sums, factor)) break;  // no point has a weight
    cholesky_solve(factor, 6, 6, sums.right);
    std::copy(sums.right, sums.right + 6, fit.coefficients);
    const double sq = sum_residuals(s.u.data(), s.v.data(), height, weight, k, fit.coefficients, s.residual.data());
    const double sum = sums.moments[0], effective = sum * sum / std::max(sums.weight2, 1e-300);
    const double rms = std::sqrt(sq / std::max(sum, 1e-300) * effective / std::max(effective - 6, 1.0));
    fit.residual = rms * radius;
    if (robust <= 0 || pass == iterations) break;
    const double scale = std::max(robust * inv, 0.5 * rms);
    weigh_residuals(s.weight.data(), s.residual.data(), k, -0.5 / std::max(scale * scale, 1e-300), s.robust.data());
    weight = s.robust.data();
    subtract_arcs(s.u.data(), s.v.data(), s.h.data(), k, fit.coefficients, s.target.data());
    height = s.target.data();
  }
  const double* q = fit.coefficients;
  fit.normal = unit(fit.frame.n - q[1] * fit.frame.t1 - q[2] * fit.frame.t2);
  return fit;
}

// One fit around a place for each of some neighbourhood sizes, ascending; all of them from one search.
template <class Visit>
inline void fit_scales(const KdTree& tree, const double* points, Vec3 center, const int64_t* sizes, size_t n, FitScratch& s,
                       Visit visit) {
  std::vector<double> sq_radius(n);
  tree.nearest(center, sizes[n - 1], 1e300, s.neighbors);
  s.neighbors.nest(sizes, n, sq_radius.data());
  load_points(points, nullptr, nullptr, 0.0, center, s);
  for (size_t j = 0; j < n; ++j)
    visit(j, fit_quadric(std::min<int64_t>(sizes[j], s.neighbors.size()), sq_radius[j], {}, 0.0, 0, s));
}

struct FitData {
  const KdTree& tree;
  const double *points, *normals;  // normals: none if null
};

// A fit that is wanted: its side and the tangent along which it is narrow may be null.
struct FitRequest {
  Vec3 center;
  const double *side, *across;
  double stretch;
  int64_t neighbors;
  double robust;
  int iterations;
};

inline LocalFit fit_around(const FitData& data, const FitRequest& wanted, FitScratch& s) {
  constexpr double kWidest = 1e6;  // a number of neighbours that still is one
  Ellipse ellipse;
  if (wanted.across) {
    ellipse.stretch = std::min(std::max(wanted.stretch, 1.0), kWidest), ellipse.across = load(wanted.across);
    ellipse.along = across_both(ellipse.across, load(wanted.side));
  }
  const auto k = static_cast<int64_t>(std::lround(wanted.neighbors * ellipse.stretch));
  data.tree.nearest(wanted.center, k, 1e300, s.neighbors);
  load_points(data.points, data.normals, wanted.side, wanted.robust, wanted.center, s);
  return fit_quadric(s.neighbors.size(), s.neighbors.sq_radius(), ellipse, wanted.robust, wanted.iterations, s);
}

}  // namespace sofnn
