// SPDX-License-Identifier: MIT
// k-d tree over 3D points: all leaves at one depth, nodes in heap order, points copied leaf by leaf.
#pragma once
#include <cstdint>
#include <limits>
#include <numeric>
#include <utility>

#include "linalg.hpp"
#include "parallel.hpp"

namespace sofnn {

struct Neighbor {
  double sq_dist;
  int64_t index;
  bool operator<(const Neighbor& o) const {  // ties by index: the answer does not depend on the tree
    return sq_dist < o.sq_dist || (sq_dist == o.sq_dist && index < o.index);
  }
};

class KdTree {
 public:
  KdTree(const double* points, int64_t n, int threads) : n_(n), points_(n), index_(n) {
    while ((n_ >> depth_) > kLeaf) ++depth_;
    split_.resize((int64_t{1} << depth_) - 1);
    axis_.resize(split_.size());
    std::iota(index_.begin(), index_.end(), int64_t{0});
    build_level(points, threads);
    for (int64_t i = 0; i < n_; ++i) points_[i] = load(points + 3 * index_[i]);
  }

  int64_t size() const { return n_; }

  // The k nearest points of x within max_sq, nearest first; heap is scratch and result.
  void nearest(Vec3 x, int64_t k, double max_sq, std::vector<Neighbor>& heap) const {
    heap.clear();
    double offset[3] = {0, 0, 0};
    if (n_ > 0 && k > 0) search(0, 0, 0, x, k, max_sq, 0.0, offset, heap);
    std::sort_heap(heap.begin(), heap.end());
  }

 private:
  static constexpr int64_t kLeaf = 12;
  int64_t n_;
  int depth_ = 0;
  std::vector<Vec3> points_;
  std::vector<int64_t> index_;
  std::vector<double> split_;
  std::vector<uint8_t> axis_;

  int64_t bound(int64_t i, int level) const {  // first point of the i-th node of a level
    return static_cast<int64_t>((static_cast<__int128>(i) * n_) >> level);
  }

  void build_level(const double* p, int threads) {
    for (int level = 0; level < depth_; ++level)
      parallel_for(int64_t{1} << level, 1, threads, [&](int64_t lo, int64_t hi) {
        for (int64_t i = lo; i < hi; ++i) split_node(p, level, i);
      });
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
    const int64_t node = (int64_t{1} << level) - 1 + i;
    split_[node] = p[3 * index_[mid] + axis];
    axis_[node] = static_cast<uint8_t>(axis);
  }

  void search(int level, int64_t i, int64_t node, Vec3 x, int64_t k, double max_sq, double sq,
              double* offset, std::vector<Neighbor>& heap) const {
    if (level == depth_) {
      for (int64_t j = bound(i, level), end = bound(i + 1, level); j < end; ++j) {
        const Vec3 d = points_[j] - x;
        const Neighbor candidate{dot(d, d), index_[j]};
        if (candidate.sq_dist > max_sq) continue;
        if (static_cast<int64_t>(heap.size()) < k) {
          heap.push_back(candidate);
          std::push_heap(heap.begin(), heap.end());
        } else if (candidate < heap.front()) {
          std::pop_heap(heap.begin(), heap.end());
          heap.back() = candidate;
          std::push_heap(heap.begin(), heap.end());
        }
      }
      return;
    }
    const int axis = axis_[node];
    const double diff = (axis == 0 ? x.x : axis == 1 ? x.y : x.z) - split_[node];
    const int64_t near = diff < 0 ? 0 : 1, far = 1 - near;
    search(level + 1, 2 * i + near, 2 * node + 1 + near, x, k, max_sq, sq, offset, heap);
    const double old = offset[axis], far_sq = sq - old * old + diff * diff;
    const double worst = static_cast<int64_t>(heap.size()) < k ? max_sq : std::min(max_sq, heap.front().sq_dist);
    if (far_sq <= worst * (1 + 1e-12)) {  // rounding must not hide an equally near point with a lower index
      offset[axis] = diff;
      search(level + 1, 2 * i + far, 2 * node + 1 + far, x, k, max_sq, far_sq, offset, heap);
      offset[axis] = old;
    }
  }
};

}  // namespace sofnn
