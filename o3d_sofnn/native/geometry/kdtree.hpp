// SPDX-License-Identifier: MIT
// k-d tree over 3D points: all leaves at one depth, nodes in heap order, points copied leaf by leaf.
#pragma once
#include <cstdint>
#include <limits>
#include <numeric>
#include <utility>

#include "geometry/neighbors.hpp"
#include "geometry/parallel.hpp"
#include "geometry/simd.hpp"

namespace sofnn {

class KdTree {
 public:
  KdTree(const double* points, int64_t n, int threads) : n_(n), threads_(threads), index_(n) {
    while ((n_ >> depth_) > kLeaf) ++depth_;
    std::iota(index_.begin(), index_.end(), int64_t{0});
    for (int level = 0; level < depth_; ++level)
      parallel_for(int64_t{1} << level, 1, threads, [&](int64_t lo, int64_t hi) {
        for (int64_t i = lo; i < hi; ++i) split_node(points, level, i);
      });
    x_.resize(n_), y_.resize(n_), z_.resize(n_);
    parallel_for(n_, 4096, threads, [&](int64_t lo, int64_t hi) {
      for (int64_t i = lo; i < hi; ++i) {
        const double* p = points + 3 * index_[i];
        x_[i] = p[0], y_[i] = p[1], z_[i] = p[2];
      }
    });
    build_boxes(threads);
  }

  int64_t size() const { return n_; }
  int threads() const { return threads_; }  // that searches may start, too

  // The k nearest points of x within max_sq, in no order.
  void nearest(Vec3 x, int64_t k, double max_sq, Search& s) const { search(*this, x, k, max_sq, s); }

  // The same, nearest first.
  void nearest_sorted(Vec3 x, int64_t k, double max_sq, Search& s) const {
    search(*this, x, k, max_sq, s);
    if (k > kFew) std::sort(s.found_.data(), s.found_.data() + s.size_);
  }

  // Whether at least k points lie within a squared distance.
  bool crowded(Vec3 x, int64_t k, double sq_reach) const {
    const int64_t first_leaf = (int64_t{1} << depth_) - 1;
    int64_t stack[64], top = 0, count = 0;
    if (n_ >= k) stack[top++] = 0;
    while (top > 0 && count < k) {
      const int64_t node = stack[--top];
      if (node < first_leaf) {  // the nearer child on top
        const double a = sq_to_box(box_[2 * node + 1], x), b = sq_to_box(box_[2 * node + 2], x);
        const int64_t near = a <= b ? 1 : 2;
        if (std::max(a, b) <= sq_reach) stack[top++] = 2 * node + 3 - near;
        if (std::min(a, b) <= sq_reach) stack[top++] = 2 * node + near;
        continue;
      }
      const int64_t lo = bound(node - first_leaf, depth_), n = bound(node - first_leaf + 1, depth_) - lo;
      double sq[2 * kLeaf];
      squared_distances(&x_[lo], &y_[lo], &z_[lo], n, x.x, x.y, x.z, sq);
      for (int64_t i = 0; i < n; ++i) count += sq[i] <= sq_reach;
    }
    return count >= k;
  }

  // The k nearest points of each of n places, and a few more, by one search around their middle; false when the places
  // lie too far apart for that to pay.
  bool gather(const double* x, int64_t n, int64_t k, Candidates& out) const {
    Vec3 middle{0, 0, 0};
    double radius = 0;
    for (int64_t i = 0; i < n; ++i) middle = middle + (1.0 / static_cast<double>(n)) * load(x + 3 * i);
    for (int64_t i = 0; i < n; ++i) radius = std::max(radius, norm(load(x + 3 * i) - middle));
    search(*this, middle, k, std::numeric_limits<double>::infinity(), out.middle);
    const double nearest = std::sqrt(out.middle.sq_radius());
    if (n > 1 && radius > nearest) return false;
    // Each place has k neighbours within nearest + radius of itself, so within nearest + 2 radius of the middle.
    const double reach = (nearest + 2 * radius) * (1 + 1e-9);
    out.size = 0;
    within(middle, reach * reach, out);
    return true;
  }

 private:
  static constexpr int64_t kLeaf = 16;
  static constexpr int64_t kFew = 16;  // so few neighbours are kept sorted during the search
  struct Box {
    double low[3], high[3];
  };
  int64_t n_;
  int threads_;
  int depth_ = 0;
  std::vector<double> x_, y_, z_;
  std::vector<int64_t> index_;
  std::vector<Box> box_;

  int64_t bound(int64_t i, int level) const {  // first point of the i-th node of a level
    return (i * n_) >> level;
  }

  void split_node(const double* p, int level, int64_t i) {
    const int64_t lo = bound(i, level), hi = bound(i + 1, level), mid = bound(2 * i + 1, level + 1);
    double low[3], high[3];
    for (int d = 0; d < 3; ++d) low[d] = 1e300, high[d] = -1e300;
    for (int64_t j = lo; j < hi; ++j)
      for (int d = 0; d < 3; ++d) {
        const double v = p[3 * index_[j] + d];
        low[d] = std::min(low[d], v), high[d] = std::max(high[d], v);
      }
    int axis = 0;
    for (int d = 1; d < 3; ++d)
      if (high[d] - low[d] > high[axis] - low[axis]) axis = d;
    const auto begin = index_.begin();
    std::nth_element(begin + lo, begin + mid, begin + hi, [&](int64_t a, int64_t b) {
      const double x = p[3 * a + axis], y = p[3 * b + axis];
      return x < y || (x == y && a < b);
    });
  }

  void build_boxes(int threads) {
    const int64_t leaves = int64_t{1} << depth_;
    box_.resize(2 * leaves - 1);
    parallel_for(leaves, 256, threads, [&](int64_t lo, int64_t hi) {
      for (int64_t i = lo; i < hi; ++i) {
        Box& b = box_[leaves - 1 + i];
        for (int d = 0; d < 3; ++d) b.low[d] = 1e300, b.high[d] = -1e300;
        for (int64_t j = bound(i, depth_); j < bound(i + 1, depth_); ++j) {
          const double p[3] = {x_[j], y_[j], z_[j]};
          for (int d = 0; d < 3; ++d) b.low[d] = std::min(b.low[d], p[d]), b.high[d] = std::max(b.high[d], p[d]);
        }
      }
    });
    for (int64_t i = leaves - 2; i >= 0; --i)
      for (int d = 0; d < 3; ++d) {
        box_[i].low[d] = std::min(box_[2 * i + 1].low[d], box_[2 * i + 2].low[d]);
        box_[i].high[d] = std::max(box_[2 * i + 1].high[d], box_[2 * i + 2].high[d]);
      }
  }

  static SOFNN_INLINE double sq_to_box(const Box& b, Vec3 x) {
    const double p[3] = {x.x, x.y, x.z};
    double sum = 0;
    for (int d = 0; d < 3; ++d) {
      const double out = std::max(std::max(b.low[d] - p[d], p[d] - b.high[d]), 0.0);
      sum += out * out;
    }
    return sum;
  }

  static SOFNN_INLINE void insert_sorted(Neighbor* found, Neighbor candidate, int64_t k, int64_t& size) {
    int64_t j = size < k ? size++ : k - 1;
    for (; j > 0 && candidate < found[j - 1]; --j) found[j] = found[j - 1];
    found[j] = candidate;
  }

  void within(Vec3 x, double sq_reach, Candidates& out) const {
    const int64_t first_leaf = (int64_t{1} << depth_) - 1;
    int64_t stack[64], top = 0;
    stack[top++] = 0;
    while (top > 0) {
      const int64_t node = stack[--top];
      if (sq_to_box(box_[node], x) > sq_reach) continue;
      if (node < first_leaf) {
        stack[top++] = 2 * node + 2, stack[top++] = 2 * node + 1;
        continue;
      }
      const int64_t lo = bound(node - first_leaf, depth_), n = bound(node - first_leaf + 1, depth_) - lo;
      double sq[2 * kLeaf];
      squared_distances(&x_[lo], &y_[lo], &z_[lo], n, x.x, x.y, x.z, sq);
      if (static_cast<int64_t>(out.index.size()) < out.size + n) {
        for (auto* column : {&out.x, &out.y, &out.z}) column->resize(2 * (out.size + n));
        out.index.resize(2 * (out.size + n));
      }
      for (int64_t i = 0; i < n; ++i) {
        out.x[out.size] = x_[lo + i], out.y[out.size] = y_[lo + i], out.z[out.size] = z_[lo + i];
        out.index[out.size] = index_[lo + i];
        out.size += sq[i] <= sq_reach;
      }
    }
  }

  static void search(const KdTree& t, Vec3 x, int64_t k, double max_sq, Search& s) {
    k = std::min(k, t.n_);
    double bound = max_sq;
    if (s.k_ >= k) {
      const double reach = std::sqrt(s.sq_radius_) + norm(x - s.place_);
      bound = std::min(bound, reach * reach * (1 + 1e-9));
    }
    // On a surface of even density the squared radius grows as the number of neighbours.
    constexpr double kSpare = 1.25;
    const double guess = s.k_ > 0 ? kSpare * s.sq_radius_ * static_cast<double>(k) / static_cast<double>(s.k_) : bound;
    int64_t m = 0;
    if (k > kFew && guess < bound) m = collect(t, x, k, guess, s);
    if (m < k) m = collect(t, x, k, bound, s);
    s.sq_radius_ = 0;
    if (m > k)
      s.sq_radius_ = select_nearest(s.found_.data(), m, k, s.tied_).sq_dist, m = k;
    else
      for (int64_t i = 0; i < m; ++i) s.sq_radius_ = std::max(s.sq_radius_, s.found_[i].sq_dist);
    s.size_ = m, s.place_ = x;
    s.k_ = m == k ? k : 0;  // fewer within the limit say nothing about the next place
  }

  // At least the k nearest points within worst, in s.found_; returns how many.
  SOFNN_CLONES static int64_t collect(const KdTree& t, Vec3 x, int64_t k, double worst, Search& s) {
    constexpr double kSlack = 1 + 1e-12;  // rounding must not hide an equally near point with a lower index
    struct Entry {
      int64_t node;
      double sq;
    } stack[64];
    const int64_t enough = k <= kFew ? k : 2 * k + 32, first_leaf = (int64_t{1} << t.depth_) - 1;
    if (static_cast<int64_t>(s.found_.size()) < enough + 2 * kLeaf) s.found_.resize(enough + 2 * kLeaf);
    Neighbor* found = s.found_.data();
    int64_t m = 0, top = 0;
    if (k > 0) stack[top++] = {0, sq_to_box(t.box_[0], x)};
    while (top > 0) {
      const Entry entry = stack[--top];
      if (entry.sq > worst * kSlack) continue;
      int64_t node = entry.node;
      while (node < first_leaf) {
        const double a = sq_to_box(t.box_[2 * node + 1], x), b = sq_to_box(t.box_[2 * node + 2], x);
        const int64_t near = a <= b ? 1 : 2;
        const double far_sq = a <= b ? b : a;
        if (far_sq <= worst * kSlack) stack[top++] = {2 * node + 3 - near, far_sq};
        node = 2 * node + near;
      }
      const int64_t lo = t.bound(node - first_leaf, t.depth_), n = t.bound(node - first_leaf + 1, t.depth_) - lo;
      double sq[2 * kLeaf];
      squared_distances(&t.x_[lo], &t.y_[lo], &t.z_[lo], n, x.x, x.y, x.z, sq);
      if (k <= kFew) {
        for (int64_t i = 0; i < n; ++i) {
          if (sq[i] > worst) continue;
          const Neighbor candidate{sq[i], t.index_[lo + i]};
          if (m == k && !(candidate < found[k - 1])) continue;
          insert_sorted(found, candidate, k, m);
          if (m == k) worst = std::min(worst, found[k - 1].sq_dist);
        }
      } else {
        for (int64_t i = 0; i < n; ++i) {
          found[m] = {sq[i], t.index_[lo + i]};
          m += sq[i] <= worst;
        }
        if (m > enough) worst = select_nearest(found, m, k, s.tied_).sq_dist, m = k;
      }
    }
    return m;
  }
};

}  // namespace sofnn
