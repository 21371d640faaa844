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

struct SourceBuffer {
  std::vector<float> x, y, z, mx, my, mz, q;
  int64_t size = 0;
  void reserve(int64_t n) {
    for (auto* a : {&x, &y, &z, &mx, &my, &mz, &q})
      if (static_cast<int64_t>(a->size()) < n) a->resize(2 * n);
  }
};

SOFNN_CLONES inline WindingSums sum_sources(const float* __restrict x, const float* __restrict y,
                                            const float* __restrict z, const float* __restrict mx,
                                            const float* __restrict my, const float* __restrict mz,
                                            const float* __restrict q, int64_t n, float tx, float ty,
                                            float tz, float sq_width) {
  float w = 0, gx = 0, gy = 0, gz = 0, ax = 0, ay = 0, az = 0;
  for (int64_t i = 0; i < n; ++i) {
    const float dx = x[i] - tx, dy = y[i] - ty, dz = z[i] - tz;
    const float r2 = dx * dx + dy * dy + dz * dz;
    const float inv2 = 1.0f / std::max(r2, sq_width);
    const float inv3 = inv2 * std::sqrt(inv2);
    const float md = mx[i] * dx + my[i] * dy + mz[i] * dz;
    const float c = 3.0f * md * inv2, s = q[i] * inv3;
    w += md * inv3;
    gx += inv3 * (mx[i] - c * dx), gy += inv3 * (my[i] - c * dy), gz += inv3 * (mz[i] - c * dz);
    ax += s * dx, ay += s * dy, az += s * dz;
  }
  constexpr float k = 0.07957747154594767f;  // 1 / (4 pi)
  return {k * w, {k * gx, k * gy, k * gz}, {k * ax, k * ay, k * az}};
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

  // mu (n, 3) and charge (n) may be null; width (m); out (m).
  void evaluate(const double* mu, const double* charge, const double* targets, const double* width,
                int64_t m, double theta, int threads, WindingSums* out) const {
    const int64_t nodes = (int64_t{2} << depth_) - 1;
    std::vector<float> s[4], a[4];
    for (int d = 0; d < 4; ++d) s[d].assign(n_, 0.0f), a[d].assign(nodes, 0.0f);
    for (int64_t i = 0; i < n_; ++i) {
      if (mu)
        for (int d = 0; d < 3; ++d) s[d][i] = static_cast<float>(mu[3 * index_[i] + d]);
      if (charge) s[3][i] = static_cast<float>(charge[index_[i]]);
    }
    const int64_t first_leaf = (int64_t{1} << depth_) - 1;
    for (int64_t node = nodes - 1; node >= 0; --node)
      for (int d = 0; d < 4; ++d) {
        float sum = 0;
        if (node >= first_leaf)
          for (int64_t j = bound(node - first_leaf, depth_); j < bound(node - first_leaf + 1, depth_); ++j)
            sum += s[d][j];
        else
          sum = a[d][2 * node + 1] + a[d][2 * node + 2];
        a[d][node] = sum;
      }
    parallel_for(m, kGroup, threads, [&](int64_t lo, int64_t hi) {
      SourceBuffer b;
      float c[3] = {0, 0, 0}, radius = 0;
      const int64_t count = hi - lo;
      std::vector<float> t(3 * count);
      for (int64_t i = lo; i < hi; ++i) {
        const Vec3 p = load(targets + 3 * i) - origin_;
        t[3 * (i - lo)] = static_cast<float>(p.x), t[3 * (i - lo) + 1] = static_cast<float>(p.y);
        t[3 * (i - lo) + 2] = static_cast<float>(p.z);
        for (int d = 0; d < 3; ++d) c[d] += t[3 * (i - lo) + d] / static_cast<float>(count);
      }
      for (int64_t i = 0; i < count; ++i) {
        const float x = t[3 * i] - c[0], y = t[3 * i + 1] - c[1], z = t[3 * i + 2] - c[2];
        radius = std::max(radius, x * x + y * y + z * z);
      }
      gather(c, std::sqrt(radius), static_cast<float>(1 / theta), s, a, b);
      for (int64_t i = 0; i < count; ++i) {
        const float w = static_cast<float>(width[lo + i]);
        out[lo + i] = sum_sources(b.x.data(), b.y.data(), b.z.data(), b.mx.data(), b.my.data(), b.mz.data(),
                                  b.q.data(), b.size, t[3 * i], t[3 * i + 1], t[3 * i + 2],
                                  std::max(w * w, 1e-30f));
      }
    });
  }

  // Order in which consecutive targets lie close together.
  const std::vector<int64_t>& order() const { return index_; }

 private:
  static constexpr int64_t kLeaf = 16, kGroup = 16;
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

  void gather(const float* c, float radius, float inv_theta, const std::vector<float>* s,
              const std::vector<float>* a, SourceBuffer& b) const {
    int64_t stack[64 * 2], top = 0;
    int level_stack[64 * 2];
    stack[0] = 0, level_stack[0] = 0, top = 1;
    b.size = 0;
    while (top > 0) {
      --top;
      const int64_t node = stack[top];
      const int level = level_stack[top];
      const float dx = nx_[node] - c[0], dy = ny_[node] - c[1], dz = nz_[node] - c[2];
      const float reach = radius + radius_[node] * inv_theta;
      if (dx * dx + dy * dy + dz * dz > reach * reach) {
        b.reserve(b.size + 1);
        put(b, nx_[node], ny_[node], nz_[node], a[0][node], a[1][node], a[2][node], a[3][node]);
      } else if (level == depth_) {
        const int64_t i = node - ((int64_t{1} << depth_) - 1);
        b.reserve(b.size + bound(i + 1, level) - bound(i, level));
        for (int64_t j = bound(i, level); j < bound(i + 1, level); ++j)
          put(b, x_[j], y_[j], z_[j], s[0][j], s[1][j], s[2][j], s[3][j]);
      } else {
        stack[top] = 2 * node + 2, level_stack[top++] = level + 1;
        stack[top] = 2 * node + 1, level_stack[top++] = level + 1;
      }
    }
  }

  static void put(SourceBuffer& b, float x, float y, float z, float mx, float my, float mz, float q) {
    const int64_t i = b.size++;
    b.x[i] = x, b.y[i] = y, b.z[i] = z, b.mx[i] = mx, b.my[i] = my, b.mz[i] = mz, b.q[i] = q;
  }
};

}  // namespace sofnn
