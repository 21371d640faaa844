// SPDX-License-Identifier: MIT
// Barnes-Hut sums over oriented point samples: winding number, its gradient, and the transposed operator.
// Barill et al. 2018 (fast winding numbers); Lin et al. 2024 (winding-number normal consistency).
#pragma once
#include <cstring>
#include <numeric>

#include "linalg.hpp"
#include "parallel.hpp"
#include "simd.hpp"

namespace sofnn {

// d = source - target, r = max(|d|, width):
//   winding  w = sum mu.d / (4 pi r^3)        gradient  -grad w = sum (mu / r^3 - 3 (mu.d) d / r^5) / (4 pi)
//   adjoint  F = sum q d / (4 pi r^3) with scalar sources q.
struct WindingSums {
  float winding, gradient[3], adjoint[3];
};

enum class Sum { winding, gradient, adjoint };  // gradient: with the winding number

struct SourceBuffer {
  std::vector<float> x, y, z, mx, my, mz, q;
  int64_t size = 0, capacity = 0;
  void reserve(int64_t n) {
    if (n <= capacity) return;
    capacity = std::max<int64_t>(2 * n, 2048);
    for (auto* a : {&x, &y, &z, &mx, &my, &mz, &q}) a->resize(capacity);
  }
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

constexpr float kInverse4Pi = 0.07957747154594767f;

SOFNN_CLONES inline WindingSums sum_winding(const SourceBuffer& b, float tx, float ty, float tz, float sq_width) {
  const float *SOFNN_RESTRICT x = b.x.data(), *SOFNN_RESTRICT y = b.y.data(), *SOFNN_RESTRICT z = b.z.data();
  const float *SOFNN_RESTRICT mx = b.mx.data(), *SOFNN_RESTRICT my = b.my.data(), *SOFNN_RESTRICT mz = b.mz.data();
  float w = 0;
  for (int64_t i = 0; i < b.size; ++i) {
    const float dx = x[i] - tx, dy = y[i] - ty, dz = z[i] - tz;
    const float inv = inverse_sqrt(std::max(dx * dx + dy * dy + dz * dz, sq_width));
    w += (mx[i] * dx + my[i] * dy + mz[i] * dz) * (inv * inv * inv);
  }
  return {kInverse4Pi * w, {0, 0, 0}, {0, 0, 0}};
}

SOFNN_CLONES inline WindingSums sum_gradient(const SourceBuffer& b, float tx, float ty, float tz, float sq_width) {
  const float *SOFNN_RESTRICT x = b.x.data(), *SOFNN_RESTRICT y = b.y.data(), *SOFNN_RESTRICT z = b.z.data();
  const float *SOFNN_RESTRICT mx = b.mx.data(), *SOFNN_RESTRICT my = b.my.data(), *SOFNN_RESTRICT mz = b.mz.data();
  float w = 0, gx = 0, gy = 0, gz = 0;
  for (int64_t i = 0; i < b.size; ++i) {
    const float dx = x[i] - tx, dy = y[i] - ty, dz = z[i] - tz;
    const float inv = inverse_sqrt(std::max(dx * dx + dy * dy + dz * dz, sq_width));
    const float inv2 = inv * inv, inv3 = inv2 * inv;
    const float md = mx[i] * dx + my[i] * dy + mz[i] * dz;
    const float c = 3.0f * md * inv2;
    w += md * inv3;
    gx += inv3 * (mx[i] - c * dx), gy += inv3 * (my[i] - c * dy), gz += inv3 * (mz[i] - c * dz);
  }
  return {kInverse4Pi * w, {kInverse4Pi * gx, kInverse4Pi * gy, kInverse4Pi * gz}, {0, 0, 0}};
}

SOFNN_CLONES inline WindingSums sum_adjoint(const SourceBuffer& b, float tx, float ty, float tz, float sq_width) {
  const float *SOFNN_RESTRICT x = b.x.data(), *SOFNN_RESTRICT y = b.y.data(), *SOFNN_RESTRICT z = b.z.data();
  const float* SOFNN_RESTRICT q = b.q.data();
  float ax = 0, ay = 0, az = 0;
  for (int64_t i = 0; i < b.size; ++i) {
    const float dx = x[i] - tx, dy = y[i] - ty, dz = z[i] - tz;
    const float inv = inverse_sqrt(std::max(dx * dx + dy * dy + dz * dz, sq_width));
    const float s = q[i] * (inv * inv * inv);
    ax += s * dx, ay += s * dy, az += s * dz;
  }
  return {0, {0, 0, 0}, {kInverse4Pi * ax, kInverse4Pi * ay, kInverse4Pi * az}};
}

class WindingTree {
 public:
  // points (n, 3), weight: share of a point in its node's centre (areas).
  WindingTree(const double* points, const double* area, int64_t n) : n_(n), index_(n) {
    while ((n_ >> depth_) > kLeaf) ++depth_;
    std::iota(index_.begin(), index_.end(), int64_t{0});
    origin_ = {0, 0, 0};
    for (int64_t i = 0; i < n; ++i) origin_ = origin_ + (1.0 / static_cast<double>(n)) * load(points + 3 * i);
    for (int level = 0; level < depth_; ++level)
      for (int64_t i = 0; i < (int64_t{1} << level); ++i) split(points, level, i);
    x_.resize(n), y_.resize(n), z_.resize(n), area_.resize(n);
    for (int64_t i = 0; i < n; ++i) {
      const Vec3 p = load(points + 3 * index_[i]) - origin_;
      x_[i] = static_cast<float>(p.x), y_[i] = static_cast<float>(p.y), z_[i] = static_cast<float>(p.z);
      area_[i] = std::max(static_cast<float>(area[index_[i]]), 1e-30f);
    }
    const int64_t nodes = (int64_t{2} << depth_) - 1;
    nx_.resize(nodes), ny_.resize(nodes), nz_.resize(nodes), radius_.resize(nodes);
    for (int level = 0; level <= depth_; ++level)
      for (int64_t i = 0; i < (int64_t{1} << level); ++i) {
        const int64_t node = (int64_t{1} << level) - 1 + i;
        double c[4] = {0, 0, 0, 0};
        for (int64_t j = bound(i, level); j < bound(i + 1, level); ++j)
          c[0] += area_[j] * x_[j], c[1] += area_[j] * y_[j], c[2] += area_[j] * z_[j], c[3] += area_[j];
        nx_[node] = static_cast<float>(c[0] / c[3]), ny_[node] = static_cast<float>(c[1] / c[3]);
        nz_[node] = static_cast<float>(c[2] / c[3]);
        float r = 0;
        for (int64_t j = bound(i, level); j < bound(i + 1, level); ++j) {
          const float a = x_[j] - nx_[node], b = y_[j] - ny_[node], e = z_[j] - nz_[node];
          r = std::max(r, a * a + b * b + e * e);
        }
        radius_[node] = std::sqrt(r);
      }
  }

  int64_t size() const { return n_; }

  // source: mu (n, 3), or for the adjoint the charge (n); width (m); out (m).
  void evaluate(Sum what, const double* source, const double* targets, const double* width, int64_t m, double theta,
                int threads, WindingSums* out) const {
    const int64_t nodes = (int64_t{2} << depth_) - 1;
    const int columns = what == Sum::adjoint ? 1 : 3;
    std::vector<float> s[3], a[3];
    for (int d = 0; d < columns; ++d) {
      s[d].resize(n_), a[d].resize(nodes);
      for (int64_t i = 0; i < n_; ++i) s[d][i] = static_cast<float>(source[columns * index_[i] + d]);
    }
    const int64_t first_leaf = (int64_t{1} << depth_) - 1;
    for (int64_t node = nodes - 1; node >= 0; --node)
      for (int d = 0; d < columns; ++d) {
        float sum = 0;
        if (node >= first_leaf)
          for (int64_t j = bound(node - first_leaf, depth_); j < bound(node - first_leaf + 1, depth_); ++j)
            sum += s[d][j];
        else
          sum = a[d][2 * node + 1] + a[d][2 * node + 2];
        a[d][node] = sum;
      }
    parallel_for((m + kGroup - 1) / kGroup, kGroups, threads, [&](int64_t first, int64_t last) {
      SourceBuffer b;
      for (int64_t group = first; group < last; ++group)
        evaluate_group(what, s, a, targets, width, kGroup * group, std::min(m, kGroup * (group + 1)), theta, b, out);
    });
  }

  // Order in which consecutive targets lie close together.
  const std::vector<int64_t>& order() const { return index_; }

 private:
  static constexpr int64_t kLeaf = 16, kGroup = 16, kGroups = 16;
  int64_t n_;
  int depth_ = 0;
  Vec3 origin_;
  std::vector<int64_t> index_;
  std::vector<float> x_, y_, z_, area_, nx_, ny_, nz_, radius_;

  int64_t bound(int64_t i, int level) const {
    return static_cast<int64_t>((static_cast<__int128>(i) * n_) >> level);
  }

  void split(const double* p, int level, int64_t i) {
    const int64_t lo = bound(i, level), hi = bound(i + 1, level), mid = bound(2 * i + 1, level + 1);
    double low[3] = {1e300, 1e300, 1e300}, high[3] = {-1e300, -1e300, -1e300};
    for (int64_t j = lo; j < hi; ++j)
      for (int d = 0; d < 3; ++d) {
        low[d] = std::min(low[d], p[3 * index_[j] + d]), high[d] = std::max(high[d], p[3 * index_[j] + d]);
      }
    int axis = 0;
    for (int d = 1; d < 3; ++d)
      if (high[d] - low[d] > high[axis] - low[axis]) axis = d;
    std::nth_element(index_.begin() + lo, index_.begin() + mid, index_.begin() + hi, [&](int64_t x, int64_t y) {
      return p[3 * x + axis] < p[3 * y + axis] || (p[3 * x + axis] == p[3 * y + axis] && x < y);
    });
  }

  // Targets lo to hi share the nodes that are summed at their centres.
  void evaluate_group(Sum what, const std::vector<float>* s, const std::vector<float>* a, const double* targets,
                      const double* width, int64_t lo, int64_t hi, double theta, SourceBuffer& b,
                      WindingSums* out) const {
    const int64_t count = hi - lo;
    float t[3 * kGroup], c[3] = {0, 0, 0}, radius = 0;
    for (int64_t i = 0; i < count; ++i) {
      const Vec3 p = load(targets + 3 * (lo + i)) - origin_;
      t[3 * i] = static_cast<float>(p.x), t[3 * i + 1] = static_cast<float>(p.y), t[3 * i + 2] = static_cast<float>(p.z);
      for (int d = 0; d < 3; ++d) c[d] += t[3 * i + d] / static_cast<float>(count);
    }
    for (int64_t i = 0; i < count; ++i) {
      const float x = t[3 * i] - c[0], y = t[3 * i + 1] - c[1], z = t[3 * i + 2] - c[2];
      radius = std::max(radius, x * x + y * y + z * z);
    }
    gather(what, c, std::sqrt(radius), static_cast<float>(1 / theta), s, a, b);
    for (int64_t i = 0; i < count; ++i) {
      const float w = static_cast<float>(width[lo + i]), sq = std::max(w * w, 1e-30f);
      const float x = t[3 * i], y = t[3 * i + 1], z = t[3 * i + 2];
      out[lo + i] = what == Sum::winding    ? sum_winding(b, x, y, z, sq)
                    : what == Sum::gradient ? sum_gradient(b, x, y, z, sq)
                                            : sum_adjoint(b, x, y, z, sq);
    }
  }

  void gather(Sum what, const float* c, float radius, float inv_theta, const std::vector<float>* s,
              const std::vector<float>* a, SourceBuffer& b) const {
    int64_t stack[64 * 2], top = 1;
    int level_stack[64 * 2];
    stack[0] = 0, level_stack[0] = 0;
    b.size = 0;
    while (top > 0) {
      --top;
      const int64_t node = stack[top];
      const int level = level_stack[top];
      const float dx = nx_[node] - c[0], dy = ny_[node] - c[1], dz = nz_[node] - c[2];
      const float reach = radius + radius_[node] * inv_theta;
      if (dx * dx + dy * dy + dz * dz > reach * reach) {
        b.reserve(b.size + 1);
        put(what, b, nx_[node], ny_[node], nz_[node], a, node);
      } else if (level == depth_) {
        const int64_t i = node - ((int64_t{1} << depth_) - 1);
        b.reserve(b.size + bound(i + 1, level) - bound(i, level));
        for (int64_t j = bound(i, level); j < bound(i + 1, level); ++j) put(what, b, x_[j], y_[j], z_[j], s, j);
      } else {
        stack[top] = 2 * node + 2, level_stack[top++] = level + 1;
        stack[top] = 2 * node + 1, level_stack[top++] = level + 1;
      }
    }
  }

  static void put(Sum what, SourceBuffer& b, float x, float y, float z, const std::vector<float>* s, int64_t j) {
    const int64_t i = b.size++;
    b.x[i] = x, b.y[i] = y, b.z[i] = z;
    if (what == Sum::adjoint)
      b.q[i] = s[0][j];
    else
      b.mx[i] = s[0][j], b.my[i] = s[1][j], b.mz[i] = s[2][j];
  }
};

}  // namespace sofnn
