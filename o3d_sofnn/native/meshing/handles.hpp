// SPDX-License-Identifier: MIT
// Handles of a closed mesh and the loops that open them: tree and cotree (Eppstein, "Dynamic generators of topologically
// embedded graphs", 2003; Erickson and Whittlesey, "Greedy optimal homotopy and homology generators", 2005). The edges
// of a mesh are those of a spanning tree of the vertices, those crossed by one of the triangles, and two per handle.
#pragma once
#include <limits>
#include <queue>

#include "meshing/cutting.hpp"

namespace sofnn {

// Two half-edges for each handle of a closed mesh, from trees of fewest edges: those that close the shortest loops
// through the first vertex of a piece, so that they lie beside their handles.
inline std::vector<int32_t> handle_edges(const MeshView& mesh, const HalfEdges& half) {
  const int32_t *corners = mesh.triangles, n = static_cast<int32_t>(3 * mesh.n_triangles);
  std::vector<int32_t> depth(mesh.n_vertices, -1), queue;
  std::vector<uint8_t> in_tree(n, 0);
  for (int64_t first = 0; first < mesh.n_vertices; ++first) {
    if (depth[first] >= 0) continue;
    depth[first] = 0, queue.assign(1, static_cast<int32_t>(first));
    for (size_t i = 0; i < queue.size(); ++i)
      for (int32_t k = half.start[queue[i]]; k < half.start[queue[i] + 1]; ++k) {
        const int32_t h = half.leaving[k], end = corners[following(h)];
        if (depth[end] >= 0) continue;
        depth[end] = depth[queue[i]] + 1, queue.push_back(end);
        in_tree[h] = in_tree[half.twin[h]] = 1;
      }
  }
  std::vector<int32_t> others;
  for (int32_t h = 0; h < n; ++h)
    if (h < half.twin[h] && !in_tree[h]) others.push_back(h);
  const auto far = [&](int32_t h) { return depth[corners[h]] + depth[corners[following(h)]]; };
  std::stable_sort(others.begin(), others.end(), [&](int32_t a, int32_t b) { return far(a) > far(b); });
  Unions triangles(mesh.n_triangles);
  std::vector<int32_t> found;
  for (const int32_t h : others)
    if (!triangles.join(h / 3, half.twin[h] / 3)) found.push_back(h);
  return found;
}

// A part of a mesh with a lid on every border: a closed surface of some genus.
class Patch {
 public:
  Patch(Surface& surface, int32_t seed, double radius) : surface_(surface) {
    const std::vector<int32_t> rows = surface.patch(seed, radius);
    const auto n = static_cast<int32_t>(rows.size());
    const auto local = [&](int32_t h) {
      const int32_t t = surface.index[h / 3];
      return t < 0 ? -1 : 3 * t + h % 3;
    };
    const auto global = [&](int32_t h) { return 3 * rows[h / 3] + h % 3; };
    std::vector<int32_t> twin(3 * n), node(3 * n, -1);
    for (int32_t h = 0; h < 3 * n; ++h) twin[h] = local(surface.twin[global(h)]);
    for (const int32_t t : rows) surface.index[t] = -1;
    // A vertex at which the patch touches itself is a node for each side.
    Unions corner(3 * n);
    for (int32_t h = 0; h < 3 * n; ++h)
      if (twin[h] >= 0) corner.join(h, following(twin[h])), corner.join(following(h), twin[h]);
    for (int32_t h = 0; h < 3 * n; ++h) {
      int32_t& number = node[corner.root(h)];
      if (number < 0) number = static_cast<int32_t>(name_.size()), name_.push_back(surface.corners[global(h)]);
      node[h] = number;
    }
    Unions border(name_.size());
    std::vector<int32_t> lid(name_.size(), -1);
    for (int32_t h = 0; h < 3 * n; ++h)
      if (twin[h] < 0) border.join(node[h], node[following(h)]);
    n_sides_ = n;
    for (int32_t h = 0; h < 3 * n; ++h) {
      if (twin[h] >= 0 && twin[h] < h) continue;
      int32_t other = twin[h] / 3;
      if (twin[h] < 0) {
        int32_t& own = lid[border.root(node[h])];
        if (own < 0) own = n_sides_++;
        other = own;
      }
      const int32_t a = node[h], b = node[following(h)];
      edges_.push_back({a, b, h / 3, other, global(h), length(a, b)});
    }
    has_handle_ = static_cast<int64_t>(name_.size() + n_sides_) - static_cast<int64_t>(edges_.size()) < 2;
    if (!has_handle_) return;
    beside_.resize(name_.size());
    for (size_t e = 0; e < edges_.size(); ++e)
      beside_[edges_[e].a].push_back(static_cast<int32_t>(e)), beside_[edges_[e].b].push_back(static_cast<int32_t>(e));
    root_ = node[seed % 3];
  }

  // Half-edges of a short loop that does not divide the patch; none where there is no such loop. Each round finds the
  // shortest of those through one vertex, the next one begins at the far side of the best loop.
  std::vector<int32_t> short_loop() {
    std::vector<int32_t> best;
    if (!has_handle_) return best;
    double least = std::numeric_limits<double>::infinity();
    bool better = true;
    for (int round = 0; better && round < kRounds; ++round) {
      better = false;
      find_paths();
      int32_t far_side = root_;
      for (const int32_t e : closing_edges()) {
        const std::vector<int32_t> loop = close(edges_[e]);
        std::vector<int32_t> names, halves;
        double length = 0;
        for (size_t i = 0; i < loop.size(); ++i) {
          const int32_t next = loop[(i + 1) % loop.size()];
          length += this->length(loop[i], next);
          names.push_back(name_[loop[i]]), halves.push_back(half_edge(loop[i], next));
        }
        std::sort(names.begin(), names.end());
        const bool simple = std::adjacent_find(names.begin(), names.end()) == names.end();
        if (simple && length < kShorter * least) least = length, best = halves, far_side = loop[loop.size() / 2], better = true;
      }
      root_ = far_side;
    }
    return best;
  }

 private:
  static constexpr int kRounds = 3;
  static constexpr double kShorter = 1 - 1e-9;

  struct Edge {
    int32_t a, b, one, other, half;  // nodes, the triangles or lids on both sides, and the half-edge from a to b
    double length;
  };
  const Surface& surface_;
  std::vector<int32_t> name_;
  std::vector<Edge> edges_;
  std::vector<std::vector<int32_t>> beside_;
  int32_t n_sides_ = 0, root_ = 0;
  bool has_handle_ = false;
  std::vector<double> distance_;
  std::vector<int32_t> way_;  // edge that leads to each node

  // Finite whatever the places are: every node of the patch is reached by some path.
  double length(int32_t a, int32_t b) const {
    constexpr double kLongest = 1e100;
    return std::min(kLongest, norm(surface_.vertex(name_[a]) - surface_.vertex(name_[b])));
  }

  int32_t before(int32_t node) const {
    const Edge& e = edges_[way_[node]];
    return e.a == node ? e.b : e.a;
  }

  int32_t half_edge(int32_t a, int32_t b) const {
    for (const int32_t e : beside_[a]) {
      if (edges_[e].b == b) return edges_[e].half;
      if (edges_[e].a == b) return surface_.twin[edges_[e].half];
    }
    return -1;
  }

  void find_paths() {
    distance_.assign(name_.size(), std::numeric_limits<double>::infinity()), way_.assign(name_.size(), -1);
    using Entry = std::pair<double, int32_t>;
    std::priority_queue<Entry, std::vector<Entry>, std::greater<Entry>> queue;
    queue.push({distance_[root_] = 0, root_});
    while (!queue.empty()) {
      const auto [reached, node] = queue.top();
      queue.pop();
      if (reached > distance_[node]) continue;
      for (const int32_t e : beside_[node]) {
        const int32_t end = edges_[e].a == node ? edges_[e].b : edges_[e].a;
        const double there = reached + edges_[e].length;
        if (there < distance_[end]) distance_[end] = there, way_[end] = e, queue.push({there, end});
      }
    }
  }

  // Edges that neither the shortest paths nor the longest cotree need.
  std::vector<int32_t> closing_edges() const {
    std::vector<int32_t> others, closing;
    for (size_t i = 0; i < edges_.size(); ++i) {
      const auto e = static_cast<int32_t>(i);
      if (way_[edges_[i].a] != e && way_[edges_[i].b] != e) others.push_back(e);
    }
    const auto around = [&](int32_t e) { return distance_[edges_[e].a] + distance_[edges_[e].b] + edges_[e].length; };
    std::stable_sort(others.begin(), others.end(), [&](int32_t a, int32_t b) { return around(a) > around(b); });
    Unions sides(n_sides_);
    for (const int32_t e : others)
      if (!sides.join(edges_[e].one, edges_[e].other)) closing.push_back(e);
    return closing;
  }

  // The loop of an edge and the paths to its ends, without what they have in common.
  std::vector<int32_t> close(const Edge& e) const {
    std::vector<int32_t> one{e.a}, other{e.b};
    while (one.back() != root_) one.push_back(before(one.back()));
    while (other.back() != root_) other.push_back(before(other.back()));
    while (one.size() > 1 && other.size() > 1 && one[one.size() - 2] == other[other.size() - 2]) one.pop_back(), other.pop_back();
    one.insert(one.end(), other.rbegin() + 1, other.rend());
    return one;
  }
};

// Opens the handles that lie in a ball of some radius around the middle of an edge, for one edge after the other.
inline void open_handles(Surface& surface, const int32_t* edges, const double* radius, int64_t n) {
  for (int64_t i = 0; i < n; ++i)
    for (std::vector<int32_t> loop = Patch(surface, edges[i], radius[i]).short_loop(); !loop.empty();
         loop = Patch(surface, edges[i], radius[i]).short_loop())
      surface.cut(loop);
}

}  // namespace sofnn
