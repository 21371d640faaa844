// SPDX-License-Identifier: MIT
// Plane and quadric fits around given centres, several neighbourhood sizes at once (Algorithm 1, steps 3 and 5).
#pragma once
#include "kdtree.hpp"

namespace sofnn {

// One fit: a frame at the foot point of the centre and heights h = c0 + c1 u + c2 v + c3 u^2 + c4 uv + c5 v^2
// in that frame, lengths in units of the radius. slope_error: standard error of the normal in radians.
struct LocalFit {
  Vec3 normal, foot;
  double rms, slope_error, radius, surface_variation;
  double coefficients[6];
  Frame frame;
};

struct FitScratch {
  std::vector<Neighbor> neighbors;
  std::vector<double> u, v, h, w;
};

// Weighted quadric over the first k neighbours. robust > 0 weights residuals by exp(-r^2 / (2 robust^2)), iterated.
// With oriented normals of the points and a side, points that face away from the side get no weight.
inline LocalFit fit_quadric(const double* points, const double* normals, const double* side, Vec3 center, int64_t k,
                            double robust, int iterations, FitScratch& s) {
  const double radius = std::sqrt(s.neighbors[k - 1].sq_dist) * 1.1;
  const double inv = radius > 0 ? 1 / radius : 0;
  double sum = 0, mean[3] = {0, 0, 0}, c[6] = {0, 0, 0, 0, 0, 0};
  s.w.resize(k), s.u.resize(k), s.v.resize(k), s.h.resize(k);
  for (int64_t i = 0; i < k; ++i) {
    const Vec3 d = inv * (load(points + 3 * s.neighbors[i].index) - center);
    double w = std::max(1 - dot(d, d), 0.0);
    if (normals) {
      const double agree = std::max(dot(load(normals + 3 * s.neighbors[i].index), load(side)), 0.0);
      w *= agree * agree + 1e-6;
    }
    s.w[i] = w, s.u[i] = d.x, s.v[i] = d.y, s.h[i] = d.z;
    sum += w;
    mean[0] += w * d.x, mean[1] += w * d.y, mean[2] += w * d.z;
    c[0] += w * d.x * d.x, c[1] += w * d.x * d.y, c[2] += w * d.x * d.z;
    c[3] += w * d.y * d.y, c[4] += w * d.y * d.z, c[5] += w * d.z * d.z;
  }
  sum = std::max(sum, 1e-300);
  for (double& m : mean) m /= sum;
  c[0] = c[0] / sum - mean[0] * mean[0], c[1] = c[1] / sum - mean[0] * mean[1];
  c[2] = c[2] / sum - mean[0] * mean[2], c[3] = c[3] / sum - mean[1] * mean[1];
  c[4] = c[4] / sum - mean[1] * mean[2], c[5] = c[5] / sum - mean[2] * mean[2];
  double value[3];
  Vec3 axis[3];
  eigen_symmetric3(c, value, axis);

  LocalFit fit{};
  fit.radius = radius;
  fit.surface_variation = value[0] / std::max(value[0] + value[1] + value[2], 1e-300);
  fit.frame = frame_of(unit(axis[0]));
  for (int64_t i = 0; i < k; ++i) {
    const Vec3 d{s.u[i], s.v[i], s.h[i]};
    s.u[i] = dot(d, fit.frame.t1), s.v[i] = dot(d, fit.frame.t2), s.h[i] = dot(d, fit.frame.n);
  }
  double a[36], b[6], scale = -1;
  for (int pass = 0; pass <= iterations; ++pass) {
    for (double& x : a) x = 0;
    for (double& x : b) x = 0;
    double weight = 0, weight2 = 0;
    for (int64_t i = 0; i < k; ++i) {
      const double u = s.u[i], v = s.v[i], h = s.h[i];
      double w = s.w[i];
      if (scale > 0) {
        const double* q = fit.coefficients;
        const double r = h - (q[0] + q[1] * u + q[2] * v + q[3] * u * u + q[4] * u * v + q[5] * v * v);
        w *= std::exp(-0.5 * r * r / (scale * scale));
      }
      weight += w, weight2 += w * w;
      const double f[6] = {1, u, v, u * u, u * v, v * v};
      for (int p = 0; p < 6; ++p) {
        b[p] += w * f[p] * h;
        for (int q = 0; q <= p; ++q) a[6 * p + q] += w * f[p] * f[q];
      }
    }
    const double ridge = 1e-9 * std::max(weight, 1e-300);
    a[0] += ridge * 1e-3;
    for (int p = 1; p < 6; ++p) a[7 * p] += ridge + (p > 2 ? 1e-4 * weight : 0);
    double inverse[2] = {0, 0};
    if (!cholesky(a, 6, 6)) break;
    cholesky_solve(a, 6, 6, b);
    for (int p = 1; p < 3; ++p) {
      double e[6] = {0, 0, 0, 0, 0, 0};
      e[p] = 1;
      cholesky_solve(a, 6, 6, e);
      inverse[p - 1] = e[p];
    }
    for (int p = 0; p < 6; ++p) fit.coefficients[p] = b[p];
    double sq = 0, sum_w = 0;
    for (int64_t i = 0; i < k; ++i) {
      const double u = s.u[i], v = s.v[i];
      const double r = s.h[i] - (b[0] + b[1] * u + b[2] * v + b[3] * u * u + b[4] * u * v + b[5] * v * v);
      double w = s.w[i];
      if (scale > 0) w *= std::exp(-0.5 * r * r / (scale * scale));
      sq += w * r * r, sum_w += w;
    }
    const double effective = weight * weight / std::max(weight2, 1e-300);
    const double rms = std::sqrt(sq / std::max(sum_w, 1e-300) * effective / std::max(effective - 6, 1.0));
    fit.rms = rms * radius;
    fit.slope_error = rms * std::sqrt((inverse[0] + inverse[1]) * weight2 / std::max(weight, 1e-300));
    if (robust <= 0) break;
    scale = std::max(robust * inv, 0.5 * rms);
  }
  const double* q = fit.coefficients;
  fit.normal = unit(fit.frame.n - q[1] * fit.frame.t1 - q[2] * fit.frame.t2);
  fit.foot = center + (radius * q[0]) * fit.frame.n;
  return fit;
}

}  // namespace sofnn
