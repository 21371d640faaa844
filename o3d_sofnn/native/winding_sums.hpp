// SPDX-License-Identifier: MIT
// Sums over oriented samples at a run of places, a place a vector lane: winding number, its gradient, the adjoint.
#pragma once
#include <algorithm>
#include <cstring>
#include <vector>

#include "simd.hpp"

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
//   winding  w = sum mu.d / r^3      gradient  -grad w = sum mu / r^3 - 3 (mu.d) d / r^5
//   adjoint  F = sum q d / r^3 with scalar sources q.
SOFNN_CLONES inline void sum_winding(const float* SOFNN_RESTRICT place, const float* SOFNN_RESTRICT mu,
                                     const SourceRange* ranges, int64_t n, const Run3& t, const RunValues& sq_width,
                                     RunSums& out) {
  float w[kRun] = {0};
  for (int64_t r = 0; r < n; ++r)
    for (int64_t i = ranges[r].first; i < ranges[r].last; ++i) {
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

SOFNN_CLONES inline void sum_gradient(const float* SOFNN_RESTRICT place, const float* SOFNN_RESTRICT mu,
                                      const SourceRange* ranges, int64_t n, const Run3& t, const RunValues& sq_width,
                                      RunSums& out) {
  float w[kRun] = {0}, gx[kRun] = {0}, gy[kRun] = {0}, gz[kRun] = {0};
  for (int64_t r = 0; r < n; ++r)
    for (int64_t i = ranges[r].first; i < ranges[r].last; ++i) {
      const float *s = place + 3 * i, *m = mu + 3 * i;
      SOFNN_LANES
      for (int l = 0; l < kRun; ++l) {
        const float dx = s[0] - t.x.v[l], dy = s[1] - t.y.v[l], dz = s[2] - t.z.v[l];
        const float inv = inverse_sqrt(std::max(dx * dx + dy * dy + dz * dz, sq_width.v[l]));
        const float inv2 = inv * inv, inv3 = inv2 * inv;
        const float md = m[0] * dx + m[1] * dy + m[2] * dz;
        const float c = 3.0f * md * inv2;
        w[l] += md * inv3;
        gx[l] += inv3 * (m[0] - c * dx), gy[l] += inv3 * (m[1] - c * dy), gz[l] += inv3 * (m[2] - c * dz);
      }
    }
  for (int l = 0; l < kRun; ++l)
    out.winding.v[l] = w[l], out.vector.x.v[l] = gx[l], out.vector.y.v[l] = gy[l], out.vector.z.v[l] = gz[l];
}

SOFNN_CLONES inline void sum_adjoint(const float* SOFNN_RESTRICT place, const float* SOFNN_RESTRICT charge,
                                     const SourceRange* ranges, int64_t n, const Run3& t, const RunValues& sq_width,
                                     RunSums& out) {
  float ax[kRun] = {0}, ay[kRun] = {0}, az[kRun] = {0};
  for (int64_t r = 0; r < n; ++r)
    for (int64_t i = ranges[r].first; i < ranges[r].last; ++i) {
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
