// SPDX-License-Identifier: MIT
// Boxes of triangles in a tree, and the pairs of triangles that meet.
#pragma once
#include <limits>
#include <mutex>

#include "geometry/morton.hpp"
#include "geometry/simd.hpp"
#include "meshing/intersections.hpp"
#include "meshing/mesh.hpp"

namespace sofnn {

struct Box {
  float low[3], high[3];
};

// Four boxes side by side, so that another one is compared with all of them at once.
struct FourBoxes {
  float low[3][4], high[3][4];

  FourBoxes() {
    constexpr float inf = std::numeric_limits<float>::infinity();
    for (int d = 0; d < 3; ++d) std::fill_n(low[d], 4, inf), std::fill_n(high[d], 4, -inf);
  }
  Box box(int k) const { return {{low[0][k], low[1][k], low[2][k]}, {high[0][k], high[1][k], high[2][k]}}; }
  void set(int k, const Box& box) {
    for (int d = 0; d < 3; ++d) low[d][k] = box.low[d], high[d][k] = box.high[d];
  }
  Box around() const {
    Box all = box(0);
    for (int d = 0; d < 3; ++d)
      for (int k = 1; k < 4; ++k) all.low[d] = std::min(all.low[d], low[d][k]), all.high[d] = std::max(all.high[d], high[d][k]);
    return all;
  }
  double squared_distance(int k, Vec3 place) const {
    const double x[3] = {place.x, place.y, place.z};
    double sum = 0;
    for (int d = 0; d < 3; ++d) {
      const double away = std::max({low[d][k] - x[d], x[d] - high[d][k], 0.0});
      sum += away * away;
    }
    return sum;
  }
  // Which of them meet a box, a bit each.
  int meeting(const Box& box) const {
    float gap[4];
    const float x = box.low[0], y = box.low[1], z = box.low[2], u = box.high[0], v = box.high[1], w = box.high[2];
    SOFNN_LANES
    for (int k = 0; k < 4; ++k)
      gap[k] = std::max(std::max(std::max(low[0][k] - u, x - high[0][k]), std::max(low[1][k] - v, y - high[1][k])),
                        std::max(low[2][k] - w, z - high[2][k]));
    return (gap[0] <= 0) | (gap[1] <= 0) << 1 | (gap[2] <= 0) << 2 | (gap[3] <= 0) << 3;
  }
};

// Boxes of triangles and of what they touch, four to one above, in the order of their middles along the Morton curve.
class TriangleTree {
 public:
  TriangleTree(const MeshView& mesh, int threads) : origin_{0, 0, 0}, place_(mesh.n_triangles) {
    if (mesh.n_triangles > 0) origin_ = mesh.vertex(mesh.triangles[0]);
    std::vector<double> middles(3 * mesh.n_triangles);
    parallel_for(mesh.n_triangles, 4096, threads, [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last; ++i) {
        const int32_t* t = mesh.triangles + 3 * i;
        store(&middles[3 * i], mesh.vertex(t[0]) + mesh.vertex(t[1]) + mesh.vertex(t[2]));
      }
    });
    for (const MortonEntry& e : sort_morton(middles.data(), mesh.n_triangles, threads)) {
      place_[e.index] = static_cast<int32_t>(row_.size());
      row_.push_back(static_cast<int32_t>(e.index));
    }
    levels_.emplace_back((row_.size() + 3) / 4);
    parallel_for(static_cast<int64_t>(row_.size()), 4096, threads, [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last; ++i) levels_[0][i / 4].set(i % 4, box(mesh.vertices, mesh.triangles + 3 * int64_t{row_[i]}));
    });
    while (levels_.back().size() > 1) {
      const std::vector<FourBoxes>& below = levels_.back();
      std::vector<FourBoxes> above((below.size() + 3) / 4);
      for (size_t i = 0; i < below.size(); ++i) above[i / 4].set(i % 4, below[i].around());
      levels_.push_back(std::move(above));
    }
  }

  // The box of a triangle and of what it touches, in single precision, rounded outward.
  Box box(const double* vertices, const int32_t* t) const {
    Vec3 low = load(vertices + 3 * int64_t{t[0]}) - origin_, high = low;
    for (int k = 1; k < 3; ++k) {
      const Vec3 x = load(vertices + 3 * int64_t{t[k]}) - origin_;
      low = {std::min(low.x, x.x), std::min(low.y, x.y), std::min(low.z, x.z)};
      high = {std::max(high.x, x.x), std::max(high.y, x.y), std::max(high.z, x.z)};
    }
    const Vec3 size = high - low;
    const double pad = 2 * kTouch * std::max({size.x, size.y, size.z});
    const auto down = [&](double x) { return static_cast<float>(x - pad - kSingle * std::fabs(x)); };
    const auto up = [&](double x) { return static_cast<float>(x + pad + kSingle * std::fabs(x)); };
    return {{down(low.x), down(low.y), down(low.z)}, {up(high.x), up(high.y), up(high.z)}};
  }

  // Calls visit(triangle) for those with boxes that meet a box, until it returns true.
  template <class Visit>
  bool any_meeting(const Box& box, const Visit& visit) const {
    struct Node {
      int level;
      int64_t index;
    };
    if (row_.empty()) return false;
    Node stack[64];  // three more a level, and there are 17 at most
    int size = 0;
    stack[size++] = {static_cast<int>(levels_.size()) - 1, 0};
    while (size > 0) {
      const Node node = stack[--size];
      const int meets = levels_[node.level][node.index].meeting(box);
      for (int k = 3; k >= 0; --k) {
        if (!(meets >> k & 1)) continue;
        const int64_t index = 4 * node.index + k;
        if (index >= count_below(node.level)) continue;
        if (node.level > 0) stack[size++] = {node.level - 1, index};
        else if (visit(row_[index])) return true;
      }
    }
    return false;
  }

  // Calls visit(triangle) for those with boxes nearer to a place than the root of `least`, near ones first; visits make
  // `least` smaller.
  template <class Visit>
  void by_distance(Vec3 place, const double& least, const Visit& visit) const {
    struct Node {
      double squared;
      int64_t level, index;
    };
    if (row_.empty()) return;
    const Vec3 x = place - origin_;
    Node stack[64];
    int size = 0;
    stack[size++] = {0, static_cast<int64_t>(levels_.size()) - 1, 0};
    while (size > 0) {
      const Node node = stack[--size];
      if (node.squared > least) continue;
      if (node.level < 0) {
        visit(row_[node.index]);
        continue;
      }
      const int begin = size;
      for (int k = 0; k < 4; ++k) {
        const int64_t index = 4 * node.index + k;
        if (index >= count_below(node.level)) break;
        const double squared = levels_[node.level][node.index].squared_distance(k, x);
        if (squared <= least) stack[size++] = {squared, node.level - 1, index};
      }
      std::sort(stack + begin, stack + size, [](const Node& a, const Node& b) {
        return a.squared != b.squared ? a.squared > b.squared : a.index > b.index;
      });
    }
  }

  // A triangle has another box from now on.
  void update(int32_t triangle, const Box& box) {
    int64_t i = place_[triangle];
    levels_[0][i / 4].set(i % 4, box);
    for (size_t level = 1; level < levels_.size(); ++level) {
      i /= 4;
      levels_[level][i / 4].set(i % 4, levels_[level - 1][i].around());
    }
  }

  void remove(int32_t triangle) { update(triangle, FourBoxes().box(0)); }

  // Calls visit(i, j), in any order, for the pairs with boxes that meet and of which at least one is suspect. Pairs above
  // lead to those below them.
  template <class Visit>
  void pairs_meeting(const uint8_t* suspect, int threads, const Visit& visit) const {
    if (row_.empty()) return;
    std::vector<std::vector<uint8_t>> wanted(levels_.size());  // suspects among the four
    for (size_t level = 0; level < levels_.size(); ++level) wanted[level].assign(levels_[level].size(), 0);
    for (size_t i = 0; i < row_.size(); ++i) wanted[0][i / 4] |= suspect[row_[i]] << i % 4;
    for (size_t level = 1; level < levels_.size(); ++level)
      for (size_t i = 0; i < wanted[level - 1].size(); ++i) wanted[level][i / 4] |= (wanted[level - 1][i] > 0) << i % 4;
    std::vector<FourPair> pairs{{0, 0}};
    for (size_t level = levels_.size(); level-- > 0;) {
      const int64_t count = count_below(level);
      const auto each_below = [&](FourPair p, const auto& use) {
        const FourBoxes &one = levels_[level][p.a], &other = levels_[level][p.b];
        for (int i = 0; i < 4; ++i) {
          int meets = other.meeting(one.box(i));
          if (!(wanted[level][p.a] >> i & 1)) meets &= wanted[level][p.b];
          if (p.a == p.b) meets &= 15 << i;
          for (int j = 0; j < 4; ++j)
            if (meets >> j & 1 && 4 * p.a + i < count && 4 * p.b + j < count) use(FourPair{4 * p.a + i, 4 * p.b + j});
        }
      };
      const auto n = static_cast<int64_t>(pairs.size());
      std::vector<std::vector<FourPair>> below((n + kChunk - 1) / kChunk);
      parallel_for(n, kChunk, threads, [&](int64_t first, int64_t last) {
        std::vector<FourPair>& own = below[first / kChunk];
        for (int64_t k = first; k < last; ++k) {
          if (level > 0) each_below(pairs[k], [&](FourPair p) { own.push_back(p); });
          else each_below(pairs[k], [&](FourPair p) { if (p.a != p.b) visit(row_[p.a], row_[p.b]); });
        }
      });
      pairs.clear();
      for (const auto& own : below) pairs.insert(pairs.end(), own.begin(), own.end());
    }
  }

 private:
  struct FourPair {
    int32_t a, b;
  };
  // What the boxes of a level are around. Those that fill up a four meet nothing, but for boxes that are no numbers.
  int64_t count_below(int64_t level) const {
    return static_cast<int64_t>(level > 0 ? levels_[level - 1].size() : row_.size());
  }

  static constexpr int64_t kChunk = 1024;
  static constexpr double kSingle = 2e-7;  // more than the rounding to single precision
  Vec3 origin_;
  std::vector<int32_t> place_, row_;  // place of each triangle, triangle at each place
  std::vector<std::vector<FourBoxes>> levels_;
};

// Coordinates times a power of two, so that the longest side is 1 to 2: the eighth powers of lengths are numbers.
inline std::vector<double> scaled_vertices(const MeshView& mesh) {
  std::vector<double> scaled(mesh.vertices, mesh.vertices + 3 * mesh.n_vertices);
  double extent = 0;
  for (int d = 0; d < 3 && mesh.n_vertices > 0; ++d) {
    double low = scaled[d], high = low;
    for (size_t i = d; i < scaled.size(); i += 3) low = std::min(low, scaled[i]), high = std::max(high, scaled[i]);
    extent = std::max(extent, 0.5 * high - 0.5 * low);
  }
  if (!(extent > 0) || !std::isfinite(extent)) return scaled;
  const int power = -std::ilogb(extent) - 1;
  for (double& x : scaled) x = std::ldexp(x, power);
  return scaled;
}

// Rows of the suspect triangles and of all with boxes that meet theirs, in ascending order.
inline std::vector<int32_t> around_suspects(const MeshView& mesh, const bool* suspect, int threads) {
  std::vector<int32_t> corners, rows;
  for (int64_t i = 0; i < mesh.n_triangles; ++i)
    if (suspect[i]) corners.insert(corners.end(), mesh.triangles + 3 * i, mesh.triangles + 3 * i + 3);
  const auto n = static_cast<int64_t>(corners.size() / 3);
  std::vector<uint8_t> near(mesh.n_triangles, 1);
  if (n < mesh.n_triangles / 2) {
    const TriangleTree tree({mesh.vertices, corners.data(), mesh.n_vertices, n}, threads);
    parallel_for(mesh.n_triangles, 4096, threads, [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last; ++i)
        near[i] = suspect[i] || tree.any_meeting(tree.box(mesh.vertices, mesh.triangles + 3 * i), [](int32_t) { return true; });
    });
  }
  for (int64_t i = 0; i < mesh.n_triangles; ++i)
    if (near[i]) rows.push_back(static_cast<int32_t>(i));
  return rows;
}

// Pairs of triangles that meet, of which at least one is suspect: the lesser row first, in ascending order.
inline std::vector<int32_t> intersecting_pairs(const MeshView& given, const bool* suspect, int threads) {
  const std::vector<double> vertices = scaled_vertices(given);
  const MeshView all{vertices.data(), given.triangles, given.n_vertices, given.n_triangles};
  const std::vector<int32_t> rows = around_suspects(all, suspect, threads);
  std::vector<int32_t> corners;
  std::vector<uint8_t> suspects;
  for (const int32_t row : rows) {
    corners.insert(corners.end(), all.triangles + 3 * int64_t{row}, all.triangles + 3 * int64_t{row} + 3);
    suspects.push_back(suspect[row]);
  }
  const MeshView mesh{vertices.data(), corners.data(), all.n_vertices, static_cast<int64_t>(rows.size())};
  std::vector<std::pair<int32_t, int32_t>> found;
  std::mutex mutex;
  TriangleTree(mesh, threads).pairs_meeting(suspects.data(), threads, [&](int32_t i, int32_t j) {
    if (!triangles_meet(mesh.vertices, mesh.triangles + 3 * int64_t{i}, mesh.triangles + 3 * int64_t{j})) return;
    const std::lock_guard<std::mutex> lock(mutex);  // hardly ever
    found.push_back({rows[std::min(i, j)], rows[std::max(i, j)]});
  });
  std::sort(found.begin(), found.end());
  std::vector<int32_t> pairs;
  for (const auto& [i, j] : found) pairs.insert(pairs.end(), {i, j});
  return pairs;
}

}  // namespace sofnn
