// SPDX-License-Identifier: MIT
// Handles of a closed mesh and the loops that open them: tree and cotree (Eppstein, "Dynamic generators of topologically
// embedded graphs", 2003; Erickson and Whittlesey, "Greedy optimal homotopy and homology generators", 2005). The edges of
// a tree over the vertices, without them those of a tree over the triangles, and two edges a handle make all of a mesh.
#pragma once
#include <queue>

#include "mesh.hpp"

namespace sofnn {

// Half-edge 3 t + k goes from corner k of triangle t to the next one.
inline int32_t following(int32_t h) { return h % 3 < 2 ? h + 1 : h - 2; }

class Unions {
 public:
  explicit Unions(int64_t n) : parent_(n) { std::iota(parent_.begin(), parent_.end(), 0); }

  int32_t root(int32_t i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }

  // False where both are in one set already.
  bool join(int32_t a, int32_t b) {
    a = root(a), b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
    return a != b;
  }

 private:
  std::vector<int32_t> parent_;
};

// Half-edges by the vertex that they leave, and the twin of each, -1 at a border.
struct HalfEdges {
  std::vector<int32_t> start, leaving, twin;

  HalfEdges(const int32_t* corners, int32_t n, int64_t n_vertices) : start(n_vertices + 1, 0), leaving(n), twin(n, -1) {
    for (int32_t h = 0; h < n; ++h) ++start[corners[h] + 1];
    std::partial_sum(start.begin(), start.end(), start.begin());
    std::vector<int32_t> next(start.begin(), start.end() - 1);
    for (int32_t h = 0; h < n; ++h) leaving[next[corners[h]]++] = h;
    for (int32_t h = 0; h < n; ++h) {
      const int32_t end = corners[following(h)];
      for (int32_t i = start[end]; i < start[end + 1]; ++i)
        if (corners[following(leaving[i])] == corners[h]) twin[h] = leaving[i];
    }
  }
};

// Two edges for each handle of a closed mesh, as pairs of vertices, from trees of fewest edges: those that close the
// shortest loops through the first vertex of a piece, so that they lie beside their handles.
inline std::vector<int32_t> handle_edges(const MeshView& mesh) {
  const int32_t *corners = mesh.triangles, n = static_cast<int32_t>(3 * mesh.n_triangles);
  const HalfEdges half(corners, n, mesh.n_vertices);
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
    if (!triangles.join(h / 3, half.twin[h] / 3)) found.insert(found.end(), {corners[h], corners[following(h)]});
  return found;
}

// The part of a mesh that some triangles make, with a lid on every border: a closed surface of some genus.
class Patch {
 public:
  // Only what hangs together with the edge from first to second.
  Patch(const double* vertices, const int32_t* triangles, int32_t n, int32_t first, int32_t second) : vertices_(vertices) {
    std::vector<int32_t> known(triangles, triangles + 3 * n), corners(3 * n);
    std::sort(known.begin(), known.end());
    known.erase(std::unique(known.begin(), known.end()), known.end());
    for (int32_t h = 0; h < 3 * n; ++h)
      corners[h] = static_cast<int32_t>(std::lower_bound(known.begin(), known.end(), triangles[h]) - known.begin());
    const HalfEdges half(corners.data(), 3 * n, known.size());
    // A vertex at which the patch touches itself is a node for each side.
    Unions corner(3 * n), piece(n);
    int32_t seed = -1;
    for (int32_t h = 0; h < 3 * n; ++h) {
      if (triangles[h] == first && triangles[following(h)] == second) seed = h / 3;
      const int32_t g = half.twin[h];
      if (g >= 0) corner.join(h, following(g)), piece.join(h / 3, g / 3);
    }
    if (seed < 0) return;
    std::vector<int32_t> node(3 * n, -1);
    int64_t count = 0;
    for (int32_t t = 0; t < n; ++t) {
      if (piece.root(t) != piece.root(seed)) continue;
      ++count;
      for (int32_t h = 3 * t; h < 3 * t + 3; ++h) {
        int32_t& number = node[corner.root(h)];
        if (number < 0) number = static_cast<int32_t>(name_.size()), name_.push_back(triangles[h]);
        node[h] = number;
      }
    }
    Unions border(name_.size());
    std::vector<int32_t> lid(name_.size(), -1);
    for (int32_t h = 0; h < 3 * n; ++h)
      if (node[h] >= 0 && half.twin[h] < 0) border.join(node[h], node[following(h)]);
    n_sides_ = n;
    for (int32_t h = 0; h < 3 * n; ++h) {
      const int32_t g = half.twin[h];
      if (node[h] < 0 || (g >= 0 && g < h)) continue;
      int32_t other = g / 3;
      if (g < 0) {
        int32_t& own = lid[border.root(node[h])];
        if (own < 0) own = n_sides_++;
        other = own;
      }
      const int32_t a = node[h], b = node[following(h)];
      edges_.push_back({a, b, h / 3, other, norm(place(a) - place(b))});
    }
    twice_genus_ = 2 - (static_cast<int64_t>(name_.size() + n_sides_) - n + count - static_cast<int64_t>(edges_.size()));
    if (twice_genus_ <= 0) return;
    beside_.resize(name_.size());
    for (size_t e = 0; e < edges_.size(); ++e)
      beside_[edges_[e].a].push_back(static_cast<int32_t>(e)), beside_[edges_[e].b].push_back(static_cast<int32_t>(e));
    root_ = node[3 * seed];
  }

  // Vertices of a short loop that does not divide the patch; none where there is no such loop. Each round finds the
  // shortest of those through one vertex, the next one begins at the far side of the best loop.
  std::vector<int32_t> short_loop() {
    std::vector<int32_t> best;
    if (twice_genus_ <= 0) return best;
    double least = std::numeric_limits<double>::infinity();
    bool better = true;
    for (int round = 0; better && round < kRounds; ++round) {
      better = false;
      find_paths();
      int32_t far_side = root_;
      for (const int32_t e : closing_edges()) {
        const std::vector<int32_t> loop = close(edges_[e]);
        double length = 0;
        for (size_t i = 0; i < loop.size(); ++i) length += norm(place(loop[i]) - place(loop[(i + 1) % loop.size()]));
        std::vector<int32_t> names;
        for (const int32_t i : loop) names.push_back(name_[i]);
        std::vector<int32_t> sorted(names);
        std::sort(sorted.begin(), sorted.end());
        const bool simple = std::adjacent_find(sorted.begin(), sorted.end()) == sorted.end();
        if (simple && length < kShorter * least) least = length, best = names, far_side = loop[loop.size() / 2], better = true;
      }
      root_ = far_side;
    }
    return best;
  }

 private:
  static constexpr int kRounds = 3;
  static constexpr double kShorter = 1 - 1e-9;

  struct Edge {
    int32_t a, b, one, other;  // nodes, and the triangles or lids on both sides
    double length;
  };
  const double* vertices_;
  std::vector<int32_t> name_;
  std::vector<Edge> edges_;
  std::vector<std::vector<int32_t>> beside_;
  int32_t n_sides_ = 0, root_ = 0;
  int64_t twice_genus_ = 0;
  std::vector<double> distance_;
  std::vector<int32_t> way_;  // edge that leads to each node

  Vec3 place(int32_t node) const { return load(vertices_ + 3 * int64_t{name_[node]}); }

  int32_t before(int32_t node) const {
    const Edge& e = edges_[way_[node]];
    return e.a == node ? e.b : e.a;
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

}  // namespace sofnn
