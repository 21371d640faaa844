// SPDX-License-Identifier: MIT
// Runs of places that lie close together: one search finds the rules for all of them, a place a lane.
#pragma once
#include <array>

#include "geometry/morton.hpp"
#include "rules/rules.hpp"

namespace sofnn {

constexpr int kLanes = 16;
using Lanes = std::array<double, kLanes>;


// A run of places with their sides (zero where unknown), and the squared distance of the k-th nearest rule of each.
struct Run {
  Lanes x, y, z, side_x, side_y, side_z, sq_limit;
  int64_t size = 0;
};

// Places in an order in which consecutive ones lie close together: their own if it is such a one, else along the Morton
// curve.
class Places {
 public:
  Places(const RuleView& view, const double* x, const double* sides, int64_t n, int64_t k, int threads)
      : x_(x), sides_(sides) {
    if (close_together(view, x, n, k)) return;
    const std::vector<MortonEntry> entries = sort_morton(x, n, threads);
    order_.resize(n), sorted_x_.resize(3 * n), sorted_sides_.resize(sides ? 3 * n : 0);
    for (int64_t i = 0; i < n; ++i) {
      order_[i] = entries[i].index;
      std::copy_n(x + 3 * order_[i], 3, &sorted_x_[3 * i]);
      if (sides) std::copy_n(sides + 3 * order_[i], 3, &sorted_sides_[3 * i]);
    }
    x_ = sorted_x_.data();
    if (sides) sides_ = sorted_sides_.data();
  }

  const double* x(int64_t i) const { return x_ + 3 * i; }
  const double* sides(int64_t i) const { return sides_ ? sides_ + 3 * i : nullptr; }

  // Rows of so many columns back in the order of the caller.
  std::vector<double> restore(std::vector<double>&& rows, int64_t columns) const {
    if (order_.empty()) return std::move(rows);
    std::vector<double> out(rows.size());
    for (size_t i = 0; i < order_.size(); ++i) std::copy_n(&rows[columns * i], columns, &out[columns * order_[i]]);
    return out;
  }

 private:
  const double *x_, *sides_;
  std::vector<int64_t> order_;
  std::vector<double> sorted_x_, sorted_sides_;

  // Whether most of some evenly chosen runs can share one search.
  static bool close_together(const RuleView& view, const double* x, int64_t n, int64_t k) {
    constexpr int64_t kTrials = 32;
    Candidates near;
    int64_t shared = 0;
    for (int64_t t = 0; t < kTrials && n > kLanes; ++t)
      shared += view.tree.gather(x + 3 * (t * (n - kLanes) / kTrials), kLanes, k, near);
    return n <= kLanes || 2 * shared >= kTrials;
  }
};

// visit(first) for consecutive runs of n places, with the k nearest points of each among the candidates.
template <class Visit>
void for_runs(const KdTree& tree, const double* x, const double* sides, int64_t n, int64_t k, Run& run, Candidates& near,
              const Visit& visit) {
  for (int64_t lo = 0, size = kLanes; lo < n; lo += size) {
    size = std::min<int64_t>({kLanes, 2 * size, n - lo});
    while (!tree.gather(x + 3 * lo, size, k, near)) size = (size + 1) / 2;
    run.size = size;
    SOFNN_LANES
    for (int64_t l = 0; l < kLanes; ++l) {
      const int64_t i = lo + std::min(l, size - 1);
      const Vec3 p = load(x + 3 * i), side = sides ? load(sides + 3 * i) : Vec3{0, 0, 0};
      run.x[l] = p.x, run.y[l] = p.y, run.z[l] = p.z;
      run.side_x[l] = side.x, run.side_y[l] = side.y, run.side_z[l] = side.z;
    }
    visit(lo);
  }
}

}  // namespace sofnn
