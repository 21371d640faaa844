// SPDX-License-Identifier: MIT
// Sums over oriented samples at a run of places, a place a vector lane: winding number, its gradient, the adjoint.
#pragma once
#include <algorithm>
#include <cstring>
#include <vector>

#include "geometry/simd.hpp"

namespace sofnn {

constexpr int kRun = 16;  // places that are summed together

// Places of a run, or a quantity at each of them.
struct alignas(64) RunValues {
  float v[kRun];
};

struct Run3 {
  RunValues x, y, z;
};

struct RunSums {
  RunValues winding;
  Run3 vector;  // downhill gradient, or adjoint
};

// Sources first to last, in the arrays of a tree.
struct SourceRange {
  int32_t first, last;
};

// What is summed at a run: distant nodes by their moments, near points one by one.
struct RunSources {
  std::vector<SourceRange> nodes, points;
};

// Moments of dipoles mu at offsets e from a center: sum mu, and sum e mu, symmetric and without trace, as xx, xy, xz,
// yy, yz, zz (its other parts have no winding number). Of charges q: sum q, sum q e.
constexpr int kDipole = 9, kCharge = 4;

// 1 / sqrt(x) to 5e-6, without the slow division and square root: a guess from the exponent, two Newton steps.
SOFNN_INLINE float inverse_sqrt(float x) {
  int32_t bits;
  std::memcpy(&bits, &x, sizeof bits);
  bits = 0x5f375a86 - (bits >> 1);
  float y;
  std::memcpy(&y, &bits, sizeof y);
  y *= 1.5f - 0.5f * x * y * y;
  return y * (1.5f - 0.5f * x * y * y);
}

// d = source - place, r = max(|d|, width), without the factor 1 / (4 pi):
//   winding  w = sum mu.d / r^3    gradient  -grad w = sum mu / r^3 - 3 (mu.d) d / r^5    adjoint  F = sum q d / r^3
// and of nodes also the first derivatives by d, outside the width: with S = sum e mu, Q = sum q e
//   winding  -3 d.S.d / r^5    gradient  15 (d.S.d) d / r^7 - 6 S.d / r^5    adjoint  Q / r^3 - 3 (Q.d) d / r^5.
SOFNN_CLONES inline void sum_winding(const float* SOFNN_RESTRICT place, const float* SOFNN_RESTRICT node,
                                     const float* SOFNN_RESTRICT center, const float* SOFNN_RESTRICT mu,
                                     const RunSources& from, const Run3& t, const RunValues& sq_width, RunSums& out) {
  float w[kRun] = {0};
  for (const SourceRange& range : from.nodes)
    for (int64_t i = range.first; i < range.last; ++i) {
      const float *c = center + 3 * i, *m = node + kDipole * i, *s = m + 3;
      SOFNN_LANES
      for (int l = 0; l < kRun; ++l) {
        const float dx = c[0] - t.x.v[l], dy = c[1] - t.y.v[l], dz = c[2] - t.z.v[l];
        const float sq = dx * dx + dy * dy + dz * dz, inv = inverse_sqrt(std::max(sq, sq_width.v[l]));
        const float dsd = dx * (s[0] * dx + 2 * (s[1] * dy + s[2] * dz)) +
                          dy * (s[3] * dy + 2 * s[4] * dz) + s[5] * dz * dz;
        const float outside = sq > sq_width.v[l] ? 3.0f : 0.0f;
        w[l] += (m[0] * dx + m[1] * dy + m[2] * dz - outside * dsd * (inv * inv)) * (inv * inv * inv);
      }
    }
  for (const SourceRange& range : from.points)
    for (int64_t i = range.first; i < range.last; ++i) {
      const float *s = place + 3 * i, *m = mu + 3 * i;
      SOFNN_LANES
      for (int l = 0; l < kRun; ++l) {
        const float dx = s[0] - t.x.v[l], dy = s[1] - t.y.v[l], dz = s[2] - t.z.v[l];
        const float inv = inverse_sqrt(std::max(dx * dx + dy * dy + dz * dz, sq_width.v[l]));
        w[l] += (m[0] * dx + m[1] * dy + m[2] * dz) * (inv * inv * inv);
      }
    }
  for (int l = 0; l < kRun; ++l) out.winding.v[l] = w[l];
}

SOFNN_CLONES inline void sum_gradient(const float* SOFNN_RESTRICT place, const float* SOFNN_RESTRICT node,
                                      const float* SOFNN_RESTRICT center, const float* SOFNN_RESTRICT mu,
                                      const RunSources& from, const Run3& t, const RunValues& sq_width, RunSums& out) {
  float w[kRun] = {0}, gx[kRun] = {0}, gy[kRun] = {0}, gz[kRun] = {0};
  for (const SourceRange& range : from.nodes)
    for (int64_t i = range.first; i < range.last; ++i) {
      const float *c = center + 3 * i, *m = node + kDipole * i, *s = m + 3;
      SOFNN_LANES
      for (int l = 0; l < kRun; ++l) {
        const float dx = c[0] - t.x.v[l], dy = c[1] - t.y.v[l], dz = c[2] - t.z.v[l];
        const float sq = dx * dx + dy * dy + dz * dz, inv = inverse_sqrt(std::max(sq, sq_width.v[l]));
        const float inv2 = inv * inv, inv3 = inv2 * inv, outside = sq > sq_width.v[l] ? 3 * inv2 : 0.0f;
        const float sx = outside * (s[0] * dx + s[1] * dy + s[2] * dz),
                    sy = outside * (s[1] * dx + s[3] * dy + s[4] * dz),
                    sz = outside * (s[2] * dx + s[4] * dy + s[5] * dz);
        const float md = m[0] * dx + m[1] * dy + m[2] * dz, dsd = dx * sx + dy * sy + dz * sz;
        const float f = inv2 * (3 * md - 5 * dsd);
        w[l] += inv3 * (md - dsd);
        gx[l] += inv3 * (m[0] - 2 * sx - f * dx), gy[l] += inv3 * (m[1] - 2 * sy - f * dy);
        gz[l] += inv3 * (m[2] - 2 * sz - f * dz);
      }
    }
  for (const SourceRange& range : from.points)
    for (int64_t i = range.first; i < range.last; ++i) {
      const float *s = place + 3 * i, *m = mu + 3 * i;
      SOFNN_LANES
      for (int l = 0; l < kRun; ++l) {
        const float dx = s[0] - t.x.v[l], dy = s[1] - t.y.v[l], dz = s[2] - t.z.v[l];
        const float inv = inverse_sqrt(std::max(dx * dx + dy * dy + dz * dz, sq_width.v[l]));
        const float inv2 = inv * inv, inv3 = inv2 * inv;
        const float md = m[0] * dx + m[1] * dy + m[2] * dz;
        const float f = 3.0f * md * inv2;
        w[l] += md * inv3;
        gx[l] += inv3 * (m[0] - f * dx), gy[l] += inv3 * (m[1] - f * dy), gz[l] += inv3 * (m[2] - f * dz);
      }
    }
  for (int l = 0; l < kRun; ++l)
    out.winding.v[l] = w[l], out.vector.x.v[l] = gx[l], out.vector.y.v[l] = gy[l], out.vector.z.v[l] = gz[l];
}

SOFNN_CLONES inline void sum_adjoint(const float* SOFNN_RESTRICT place, const float* SOFNN_RESTRICT node,
                                     const float* SOFNN_RESTRICT center, const float* SOFNN_RESTRICT charge,
                                     const RunSources& from, const Run3& t, const RunValues& sq_width, RunSums& out) {
  float ax[kRun] = {0}, ay[kRun] = {0}, az[kRun] = {0};
  for (const SourceRange& range : from.nodes)
    for (int64_t i = range.first; i < range.last; ++i) {
      const float *c = center + 3 * i, *q = node + kCharge * i;
      SOFNN_LANES
      for (int l = 0; l < kRun; ++l) {
        const float dx = c[0] - t.x.v[l], dy = c[1] - t.y.v[l], dz = c[2] - t.z.v[l];
        const float sq = dx * dx + dy * dy + dz * dz, inv = inverse_sqrt(std::max(sq, sq_width.v[l]));
        const float inv2 = inv * inv, inv3 = inv2 * inv, outside = sq > sq_width.v[l] ? 3 * inv2 : 0.0f;
        const float f = q[0] - outside * (q[1] * dx + q[2] * dy + q[3] * dz);
        ax[l] += inv3 * (f * dx + q[1]), ay[l] += inv3 * (f * dy + q[2]), az[l] += inv3 * (f * dz + q[3]);
      }
    }
  for (const SourceRange& range : from.points)
    for (int64_t i = range.first; i < range.last; ++i) {
      const float *s = place + 3 * i, q = charge[i];
      SOFNN_LANES
      for (int l = 0; l < kRun; ++l) {
        const float dx = s[0] - t.x.v[l], dy = s[1] - t.y.v[l], dz = s[2] - t.z.v[l];
        const float inv = inverse_sqrt(std::max(dx * dx + dy * dy + dz * dz, sq_width.v[l]));
        const float f = q * (inv * inv * inv);
        ax[l] += f * dx, ay[l] += f * dy, az[l] += f * dz;
      }
    }
  for (int l = 0; l < kRun; ++l) out.vector.x.v[l] = ax[l], out.vector.y.v[l] = ay[l], out.vector.z.v[l] = az[l];
}

}  // namespace sofnn
