// SPDX-License-Identifier: MIT
// Barnes-Hut sums over oriented point samples: winding number, its gradient, and the transposed operator.
// Barill et al. 2018 (fast winding numbers); Lin et al. 2024 (winding-number normal consistency).
#pragma once
#include <cmath>
#include <limits>
#include <numeric>

#include "geometry/linalg.hpp"
#include "geometry/parallel.hpp"
#include "orientation/winding_sums.hpp"

namespace sofnn {

struct WindingSums {
  float winding, vector[3];
};

enum class Sum { winding, gradient, adjoint };  // gradient: with the winding number

// Places in runs of consecutive ones, and for each run what is summed there: it depends on positions alone, and
// finding it costs more than a sum.
struct WindingLists {
  int64_t size = 0, tree_size = 0;
  std::vector<Run3> runs;
  std::vector<RunSources> sources;  // of each run
};

class WindingTree {
 public:
  // points (n, 3), area: share of a point in its node's centre.
  WindingTree(const double* points, const double* area, int64_t n, int threads) : n_(n), threads_(threads), blocks_((n + kRun - 1) / kRun), index_(n) {
    while ((int64_t{1} << depth_) < blocks_) ++depth_;
    nodes_ = (int64_t{2} << depth_) - 1;
    std::iota(index_.begin(), index_.end(), int64_t{0});
    for (int64_t i = 0; i < n; ++i) origin_ = origin_ + (1.0 / static_cast<double>(n)) * load(points + 3 * i);
    for (int level = 0; level < depth_; ++level) each_node(level, threads, [&](int64_t i) { split(points, level, i); });
    place_.resize(3 * (nodes_ + n)), radius_.resize(nodes_);
    std::vector<double> weight(n);
    double sq_size = 0;
    for (int64_t i = 0; i < n; ++i) {
      const Vec3 p = load(points + 3 * i) - origin_;
      sq_size = std::max(sq_size, dot(p, p));
    }
    least_width_ = std::max(kResolution * single(std::sqrt(sq_size)), least_width_);
    parallel_for(n, kChunk, threads, [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last; ++i) {
        set_place(nodes_ + i, load(points + 3 * index_[i]) - origin_);
        weight[i] = std::max(area[index_[i]], 1e-30);
      }
    });
    for (int level = 0; level <= depth_; ++level)
      each_node(level, threads, [&](int64_t i) {
        const int64_t node = (int64_t{1} << level) - 1 + i, lo = bound(i, level), hi = bound(i + 1, level);
        Vec3 center{0, 0, 0};
        double sum = 1e-300, sq_radius = 0;
        for (int64_t j = lo; j < hi; ++j) center = center + weight[j] * place(nodes_ + j), sum += weight[j];
        set_place(node, (1 / sum) * center);
        for (int64_t j = lo; j < hi; ++j) {
          const Vec3 d = place(nodes_ + j) - place(node);
          sq_radius = std::max(sq_radius, dot(d, d));
        }
        // An empty leaf is always opened, and nothing is found in it.
        radius_[node] = lo < hi ? static_cast<float>(std::sqrt(sq_radius)) : std::numeric_limits<float>::infinity();
      });
  }

  int64_t size() const { return n_; }
  int threads() const { return threads_; }  // that sums may start, too

  // Order in which consecutive points lie close together.
  const std::vector<int64_t>& order() const { return index_; }

  // What is summed at m places; a node that looks smaller than theta from a whole run is summed by its moments.
  WindingLists lists(const double* places, int64_t m, double theta, int threads) const {
    WindingLists lists;
    lists.size = m, lists.tree_size = n_, lists.runs.resize((m + kRun - 1) / kRun), lists.sources.resize(lists.runs.size());
    parallel_for(static_cast<int64_t>(lists.runs.size()), kRuns, threads, [&](int64_t first, int64_t last) {
      for (int64_t r = first; r < last; ++r) {
        lists.runs[r] = load_run(places, kRun * r, m);
        walk(lists.runs[r], static_cast<float>(1 / theta), lists.sources[r]);
      }
    });
    return lists;
  }

  // source: mu (n, 3), or for the adjoint the charge (n); width (m), out (m) at the places of the lists.
  void evaluate(Sum what, const double* source, const WindingLists& lists, const double* width, int threads,
                WindingSums* out) const {
    const Moments moments = what == Sum::adjoint ? moments_of<1>(source, threads) : moments_of<3>(source, threads);
    parallel_for(static_cast<int64_t>(lists.runs.size()), kRuns, threads, [&](int64_t first, int64_t last) {
      for (int64_t r = first; r < last; ++r)
        evaluate_run(what, moments, lists.runs[r], lists.sources[r], kRun * r, lists.size, width, out);
    });
  }

  // The same at places that are asked for once: lists are not kept.
  void evaluate(Sum what, const double* source, const double* places, const double* width, int64_t m, double theta,
                int threads, WindingSums* out) const {
    const Moments moments = what == Sum::adjoint ? moments_of<1>(source, threads) : moments_of<3>(source, threads);
    parallel_for((m + kRun - 1) / kRun, kRuns, threads, [&](int64_t first, int64_t last) {
      RunSources sources;
      for (int64_t r = first; r < last; ++r) {
        const Run3 run = load_run(places, kRun * r, m);
        sources.nodes.clear(), sources.points.clear();
        walk(run, static_cast<float>(1 / theta), sources);
        evaluate_run(what, moments, run, sources, kRun * r, m, width, out);
      }
    });
  }

 private:
  static constexpr int64_t kRuns = 16, kChunk = 4096;  // runs and points handed to a thread at once
  // A leaf is a block of kRun points or empty: own points in order() are places whose runs are leaves.
  int64_t n_;
  int threads_;
  int64_t blocks_, nodes_ = 0;
  int depth_ = 0;
  Vec3 origin_{0, 0, 0};
  std::vector<int64_t> index_;
  std::vector<float> place_, radius_;  // places: nodes first, level by level, then points
  // Places are single precision: over the size of the tree they are known to so much, and a smaller smoothing width
  // says nothing but lets the inverse powers of distances overflow.
  static constexpr float kResolution = 1.0f / (1 << 26);
  float least_width_ = 1e-15f;

  template <class Body>
  void each_node(int level, int threads, const Body& body) {
    const int64_t count = int64_t{1} << level;
    parallel_for(count, 1 + count / 64, threads, [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last; ++i) body(i);
    });
  }

  int64_t bound(int64_t i, int level) const { return std::min(n_, kRun * ((i * blocks_) >> level)); }

  Vec3 place(int64_t i) const { return {place_[3 * i], place_[3 * i + 1], place_[3 * i + 2]}; }

  void set_place(int64_t i, const Vec3& p) {
    place_[3 * i] = single(p.x), place_[3 * i + 1] = single(p.y), place_[3 * i + 2] = single(p.z);
  }

  // Single precision that holds the square of a number, too.
  static float single(double x) { return static_cast<float>(std::min(std::max(x, -1e18), 1e18)); }

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

  // Sources in the order of the tree, and moments of nodes.
  struct Moments {
    std::vector<float> nodes, points;
  };

  // Dipoles with three columns, charges with one.
  template <int kColumns>
  Moments moments_of(const double* source, int threads) const {
    constexpr int kTerms = kColumns == 3 ? kDipole : kCharge;
    Moments sums{std::vector<float>(kTerms * nodes_, 0.0f), std::vector<float>(kColumns * n_)};
    const auto add = [&](int64_t node, const Vec3& offset, const float* part) {
      float* sum = &sums.nodes[kTerms * node];
      for (int d = 0; d < kColumns; ++d) sum[d] += part[d];
      const float e[3] = {static_cast<float>(offset.x), static_cast<float>(offset.y), static_cast<float>(offset.z)};
      if constexpr (kColumns == 1) {
        for (int d = 0; d < 3; ++d) sum[1 + d] += part[0] * e[d];
      } else {
        float* second = sum + 3;
        for (int i = 0; i < 3; ++i)
          for (int j = i; j < 3; ++j) *second++ += 0.5f * (e[i] * part[j] + e[j] * part[i]);
      }
    };
    const int64_t first_leaf = nodes_ / 2;
    parallel_for(first_leaf + 1, kChunk / kRun, threads, [&](int64_t first, int64_t last) {
      for (int64_t leaf = first; leaf < last; ++leaf)
        for (int64_t j = bound(leaf, depth_); j < bound(leaf + 1, depth_); ++j) {
          float* part = &sums.points[kColumns * j];
          for (int d = 0; d < kColumns; ++d) part[d] = single(source[kColumns * index_[j] + d]);
          add(first_leaf + leaf, place(nodes_ + j) - place(first_leaf + leaf), part);
        }
    });
    for (int64_t node = first_leaf - 1; node >= 0; --node)
      for (int64_t child = 2 * node + 1; child <= 2 * node + 2; ++child) {
        const float* part = &sums.nodes[kTerms * child];
        add(node, place(child) - place(node), part);
        for (int d = kColumns; d < kTerms; ++d) sums.nodes[kTerms * node + d] += part[d];
      }
    if constexpr (kColumns == 3)
      for (int64_t node = 0; node < nodes_; ++node) {
        float* second = &sums.nodes[kTerms * node + 3];
        const float mean = (second[0] + second[3] + second[5]) / 3;
        second[0] -= mean, second[3] -= mean, second[5] -= mean;
      }
    return sums;
  }

  // Places first to first + kRun of m, the last one repeated.
  Run3 load_run(const double* places, int64_t first, int64_t m) const {
    Run3 run;
    for (int64_t l = 0; l < kRun; ++l) {
      const Vec3 p = load(places + 3 * std::min(first + l, m - 1)) - origin_;
      run.x.v[l] = single(p.x), run.y.v[l] = single(p.y), run.z.v[l] = single(p.z);
    }
    return run;
  }

  void walk(const Run3& run, float inverse_theta, RunSources& sources) const {
    float c[3] = {0, 0, 0}, radius = 0;
    for (int l = 0; l < kRun; ++l) c[0] += run.x.v[l] / kRun, c[1] += run.y.v[l] / kRun, c[2] += run.z.v[l] / kRun;
    for (int l = 0; l < kRun; ++l) {
      const float dx = run.x.v[l] - c[0], dy = run.y.v[l] - c[1], dz = run.z.v[l] - c[2];
      radius = std::max(radius, dx * dx + dy * dy + dz * dz);
    }
    radius = std::sqrt(radius);
    const auto add = [](std::vector<SourceRange>& ranges, int64_t first, int64_t last) {
      if (first == last) return;
      if (!ranges.empty() && ranges.back().last == first)
        ranges.back().last = static_cast<int32_t>(last);
      else
        ranges.push_back({static_cast<int32_t>(first), static_cast<int32_t>(last)});
    };
    const int64_t first_leaf = nodes_ / 2;
    int64_t stack[2 * 64], top = 1;
    stack[0] = 0;
    while (top > 0) {
      const int64_t node = stack[--top];
      const float dx = place_[3 * node] - c[0], dy = place_[3 * node + 1] - c[1], dz = place_[3 * node + 2] - c[2];
      const float reach = radius + radius_[node] * inverse_theta;
      if (dx * dx + dy * dy + dz * dz > reach * reach)
        add(sources.nodes, node, node + 1);
      else if (node < first_leaf)
        stack[top++] = 2 * node + 2, stack[top++] = 2 * node + 1;
      else
        add(sources.points, bound(node - first_leaf, depth_), bound(node - first_leaf + 1, depth_));
    }
  }

  void evaluate_run(Sum what, const Moments& moments, const Run3& run, const RunSources& sources, int64_t first,
                    int64_t m, const double* width, WindingSums* out) const {
    constexpr float kInverse4Pi = 0.07957747154594767f;
    RunValues sq_width;
    for (int64_t l = 0; l < kRun; ++l) {
      const float w = single(width[std::min(first + l, m - 1)]);
      sq_width.v[l] = std::max(w * w, least_width_ * least_width_);
    }
    RunSums sums{};
    const auto sum = what == Sum::winding ? sum_winding : what == Sum::gradient ? sum_gradient : sum_adjoint;
    sum(place_.data() + 3 * nodes_, moments.nodes.data(), place_.data(), moments.points.data(), sources, run, sq_width,
        sums);
    for (int64_t l = 0; l < std::min<int64_t>(kRun, m - first); ++l)
      out[first + l] = {kInverse4Pi * sums.winding.v[l],
                        {kInverse4Pi * sums.vector.x.v[l], kInverse4Pi * sums.vector.y.v[l],
                         kInverse4Pi * sums.vector.z.v[l]}};
  }
};

}  // namespace sofnn
