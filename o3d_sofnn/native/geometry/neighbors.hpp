// SPDX-License-Identifier: MIT
// What a search for the nearest points finds.
#pragma once
#include <algorithm>
#include <cstdint>
#include <vector>

#include "geometry/linalg.hpp"

namespace sofnn {

struct Neighbor {
  double sq_dist;
  int64_t index;
  bool operator<(const Neighbor& o) const {  // ties by index: the answer does not depend on the tree
    return sq_dist < o.sq_dist || (sq_dist == o.sq_dist && index < o.index);
  }
};

// Moves the k smallest of m neighbours to the front, the others are lost; returns the largest of the k. Squared distances of points on
// a surface spread evenly, so that one counting pass leaves few to compare.
inline Neighbor select_nearest(Neighbor* a, int64_t m, int64_t k, std::vector<Neighbor>& tied) {
  constexpr int kBins = 256;
  double largest = 0;
  for (int64_t i = 0; i < m; ++i) largest = std::max(largest, a[i].sq_dist);
  if (m < 64 || !(largest > 1e-280)) {
    std::nth_element(a, a + k - 1, a + m);
    return a[k - 1];
  }
  const double scale = (kBins - 1) / largest;
  const auto bin = [&](const Neighbor& e) {
    const double place = e.sq_dist * scale;
    return place < kBins - 1 ? static_cast<int32_t>(place) : kBins - 1;  // that of what is no number, too
  };
  int32_t count[kBins] = {};
  for (int64_t i = 0; i < m; ++i) ++count[bin(a[i])];
  int32_t last = 0;
  for (int64_t below = count[0]; below < k && last < kBins - 1; below += count[last]) ++last;
  if (static_cast<int64_t>(tied.size()) <= m) tied.resize(2 * m);
  int64_t front = 0, ties = 0;
  for (int64_t i = 0; i < m; ++i) {
    const Neighbor e = a[i];
    const int32_t b = bin(e);
    tied[ties] = e, ties += b == last;
    a[front] = e, front += b < last;
  }
  const auto end = tied.begin() + (k - front);
  std::nth_element(tied.begin(), end - 1, tied.begin() + ties);
  std::copy(tied.begin(), end, a + front);
  return a[k - 1];
}

// The answer to one search, and scratch. What one search finds bounds the next one: consecutive places lie close
// together. A search belongs to one tree.
class Search {
 public:
  const Neighbor* begin() const { return found_.data(); }
  const Neighbor* end() const { return begin() + size_; }
  const Neighbor& operator[](int64_t i) const { return found_[i]; }
  int64_t size() const { return size_; }
  double sq_radius() const { return sq_radius_; }  // squared distance of the farthest one

  // Orders the answer so that for each of some ascending sizes the nearest points come first; sq_radius: of each size.
  void nest(const int64_t* sizes, int64_t count, double* sq_radius) {
    int64_t inside = size_;
    double farthest = sq_radius_;
    for (int64_t j = count - 1; j >= 0; --j) {
      if (sizes[j] < inside) {
        std::nth_element(found_.data(), found_.data() + sizes[j] - 1, found_.data() + inside);
        inside = sizes[j], farthest = found_[inside - 1].sq_dist;
      }
      sq_radius[j] = farthest;
    }
  }

 private:
  friend class KdTree;
  std::vector<Neighbor> found_, tied_;
  int64_t size_ = 0, k_ = 0;
  double sq_radius_ = 0;
  Vec3 place_{0, 0, 0};
};

// Points of which each of several places has its nearest ones, a column each.
struct Candidates {
  int64_t size = 0;
  std::vector<double> x, y, z;
  std::vector<int64_t> index;
  Search middle;
};

}  // namespace sofnn
