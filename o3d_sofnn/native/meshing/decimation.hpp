// SPDX-License-Identifier: MIT
// Fewer triangles: edges are collapsed where the surface changes least (Garland and Heckbert, "Surface simplification
// using quadric error metrics", 1997), but for those where the topology would change, a triangle would turn or become a
// sliver, or cut another one.
#pragma once
#include <queue>

#include "meshing/triangle_tree.hpp"

namespace sofnn {

// Weighted squared distances from planes and places: x.A.x - 2 b.x + c, with A as its lower triangle, row by row.
struct Quadric {
  double a[9] = {0, 0, 0, 0, 0, 0, 0, 0, 0}, b[3] = {0, 0, 0}, c = 0;

  void add_plane(Vec3 n, double offset, double weight) {  // n.x = offset
    const double v[3] = {n.x, n.y, n.z};
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j <= i; ++j) a[3 * i + j] += weight * v[i] * v[j];
      b[i] += weight * offset * v[i];
    }
    c += weight * offset * offset;
  }
  void add_place(Vec3 x, double weight) {
    const double v[3] = {x.x, x.y, x.z};
    for (int i = 0; i < 3; ++i) a[4 * i] += weight, b[i] += weight * v[i], c += weight * v[i] * v[i];
  }
  Quadric operator+(const Quadric& o) const {
    Quadric sum = *this;
    for (int i = 0; i < 9; ++i) sum.a[i] += o.a[i];
    for (int i = 0; i < 3; ++i) sum.b[i] += o.b[i];
    sum.c += o.c;
    return sum;
  }
  double at(Vec3 x) const {
    const double v[3] = {x.x, x.y, x.z};
    double value = c;
    for (int i = 0; i < 3; ++i) {
      value += (a[4 * i] * v[i] - 2 * b[i]) * v[i];
      for (int j = 0; j < i; ++j) value += 2 * a[3 * i + j] * v[i] * v[j];
    }
    return value;
  }
  // Where it is least; elsewhere if that is nowhere.
  Vec3 lowest(Vec3 elsewhere) const {
    Quadric copy = *this;
    if (!cholesky(copy.a, 3, 3)) return elsewhere;
    cholesky_solve(copy.a, 3, 3, copy.b);
    return load(copy.b);
  }
};

class Decimation {
 public:
  Decimation(const MeshView& mesh, int threads)
      : vertices(mesh.vertices, mesh.vertices + 3 * mesh.n_vertices),
        corners(mesh.triangles, mesh.triangles + 3 * mesh.n_triangles),
        origin_(mesh.n_vertices > 0 ? mesh.vertex(0) : Vec3{0, 0, 0}),
        first_(mesh.n_vertices, -1),
        next_(3 * mesh.n_triangles, -1),
        age_(mesh.n_vertices, 0),
        mark_(mesh.n_vertices, 0),
        dead_(mesh.n_triangles, 0),
        changing_(mesh.n_triangles, 0),
        quadrics_(mesh.n_vertices),
        left_(mesh.n_triangles),
        tree_(mesh, threads) {
    for (auto h = static_cast<int32_t>(next_.size()) - 1; h >= 0; --h) next_[h] = first_[corners[h]], first_[corners[h]] = h;
    for (int32_t t = 0; t < static_cast<int32_t>(dead_.size()); ++t) add_quadrics(t);
  }

  // Collapses edges until a number of triangles is left or none can be collapsed. What has failed is tried again as long
  // as that takes away a part of the rest.
  void run(int64_t target) {
    for (int64_t before = 2 * left_; left_ > target && before - left_ > before / kAgain;) {
      before = left_;
      for (int32_t v = 0; v < static_cast<int32_t>(first_.size()); ++v) {
        look_around(v);
        for (const int32_t other : neighbors_)
          if (v < other) push(v, other, kLowest);
      }
      while (left_ > target && !queue_.empty()) {
        const Collapse next = queue_.top();
        queue_.pop();
        if (next.age_a == age_[next.a] && next.age_b == age_[next.b]) collapse(next);
      }
      queue_ = {};
    }
  }

  // Leaves out what is gone; the vertex that each of the others was.
  std::vector<int32_t> compact() {
    std::vector<int32_t> left, source, number(first_.size(), -1);
    for (int32_t t = 0; t < static_cast<int32_t>(dead_.size()); ++t)
      if (!dead_[t]) left.insert(left.end(), triangle(t), triangle(t) + 3);
    for (const int32_t v : left) number[v] = 0;
    for (int32_t v = 0; v < static_cast<int32_t>(number.size()); ++v) {
      if (number[v] < 0) continue;
      number[v] = static_cast<int32_t>(source.size());
      std::copy_n(&vertices[3 * int64_t{v}], 3, &vertices[3 * source.size()]);
      source.push_back(v);
    }
    for (int32_t& v : left) v = number[v];
    vertices.resize(3 * source.size()), corners.swap(left);
    return source;
  }

  std::vector<double> vertices;
  std::vector<int32_t> corners;  // of the triangles, three each

 private:
  // Weight of a border, where the surface ends: it keeps its course.
  static constexpr double kBorder = 10;
  // Weight of the way along the surface: even triangles where it is flat. Edges of a box moved ten times as far with 1e-4.
  static constexpr double kPlace = 1e-8;
  // Least cosine between the normals of a triangle before and after.
  static constexpr double kTurn = 0.2;
  // Smallest ratio of height to longest side, unless it was smaller before; smaller ones make needles on flat faces.
  static constexpr double kSliver = 0.05;
  // Most triangles around a vertex: each of them is compared with all the others.
  static constexpr size_t kMost = 48;
  // Part of the triangles that has to go for another turn over all edges.
  static constexpr int64_t kAgain = 100;

  enum Place : int32_t { kLowest, kFirst, kSecond };

  struct Collapse {
    double cost;
    int32_t a, b, place, age_a, age_b;

    bool operator<(const Collapse& o) const {  // the last one is the first to go
      return cost != o.cost ? cost > o.cost : a != o.a ? a > o.a : b != o.b ? b > o.b : place > o.place;
    }
  };

  Vec3 origin_;  // quadrics are about it
  std::vector<int32_t> first_, next_;  // corners at each vertex
  std::vector<int32_t> age_, mark_;    // times that a vertex has changed, and when it was seen
  std::vector<uint8_t> dead_, changing_;
  std::vector<Quadric> quadrics_;
  int64_t left_;
  int32_t now_ = 0;
  TriangleTree tree_;
  std::priority_queue<Collapse> queue_;
  std::vector<int32_t> neighbors_;

  Vec3 at(int32_t v) const { return load(&vertices[3 * int64_t{v}]); }
  const int32_t* triangle(int32_t t) const { return &corners[3 * int64_t{t}]; }
  bool has(int32_t t, int32_t v) const { return triangle(t)[0] == v || triangle(t)[1] == v || triangle(t)[2] == v; }

  std::vector<int32_t> triangles_around(int32_t v) const {
    std::vector<int32_t> found;
    for (int32_t h = first_[v]; h >= 0; h = next_[h])
      if (!dead_[h / 3]) found.push_back(h / 3);
    return found;
  }

  // The neighbours of a vertex, which are marked. On a border there is one more of them than triangles.
  void look_around(int32_t v) {
    neighbors_.clear(), ++now_;
    for (const int32_t t : triangles_around(v))
      for (int k = 0; k < 3; ++k)
        if (const int32_t other = triangle(t)[k]; other != v && mark_[other] != now_) mark_[other] = now_, neighbors_.push_back(other);
  }

  void add_quadrics(int32_t t) {
    const Vec3 normal = area_vector(vertices.data(), triangle(t));
    const double area = norm(normal);
    for (int k = 0; k < 3; ++k) {
      Quadric& q = quadrics_[triangle(t)[k]];
      const int32_t a = triangle(t)[k], b = triangle(t)[(k + 1) % 3];
      const Vec3 x = at(a) - origin_, n = unit(normal);
      q.add_plane(n, dot(n, x), area), q.add_place(x, kPlace * area);
      int beside = 0;
      for (const int32_t other : triangles_around(a)) beside += has(other, b);
      if (beside != 1) continue;
      const Vec3 edge = at(b) - at(a), upright = unit(cross(edge, n));
      for (const int32_t end : {a, b}) quadrics_[end].add_plane(upright, dot(upright, x), kBorder * dot(edge, edge));
    }
  }

  Vec3 place_of(const Quadric& q, const Collapse& c) const {
    if (c.place == kLowest) return q.lowest(0.5 * (at(c.a) + at(c.b)) - origin_) + origin_;
    return at(c.place == kFirst ? c.a : c.b);
  }

  void push(int32_t a, int32_t b, Place place) {
    Collapse c{0, std::min(a, b), std::max(a, b), place, age_[std::min(a, b)], age_[std::max(a, b)]};
    const Quadric q = quadrics_[a] + quadrics_[b];
    c.cost = q.at(place_of(q, c) - origin_);
    if (std::isfinite(c.cost)) queue_.push(c);
  }

  void collapse(const Collapse& c) {
    std::vector<int32_t> gone, changed;
    if (!keeps_topology(c.a, c.b, gone, changed)) return;
    const Quadric q = quadrics_[c.a] + quadrics_[c.b];
    const Vec3 x = place_of(q, c);
    if (changed.size() > kMost || !keeps_shape(c, x, changed) || !keeps_apart(c, x, gone, changed)) {
      if (c.place == kLowest) push(c.a, c.b, kFirst), push(c.a, c.b, kSecond);
      return;
    }
    quadrics_[c.a] = q, ++age_[c.a], ++age_[c.b];
    for (const int32_t t : gone) tree_.remove(t);
    first_[c.a] = first_[c.b] = -1;
    for (const int32_t t : changed) {
      tree_.update(t, tree_.box(vertices.data(), triangle(t)));
      for (int32_t h = 3 * t; h < 3 * t + 3; ++h)
        if (corners[h] == c.a) next_[h] = first_[c.a], first_[c.a] = h;
    }
    left_ -= static_cast<int64_t>(gone.size());
    look_around(c.a);
    for (const int32_t other : neighbors_) push(c.a, other, kLowest);
  }

  // The link condition (Dey et al., "Topology preserving edge contraction", 1999): what both ends see is what the edge
  // sees. Tells the triangles that go and those that change.
  bool keeps_topology(int32_t a, int32_t b, std::vector<int32_t>& gone, std::vector<int32_t>& changed) {
    const std::vector<int32_t> of_a = triangles_around(a), of_b = triangles_around(b);
    look_around(a);
    const bool border_a = neighbors_.size() > of_a.size();
    for (const int32_t t : of_a) (has(t, b) ? gone : changed).push_back(t);
    int common = 0;
    const std::vector<int32_t> beside_a(neighbors_);
    look_around(b);
    const bool border_b = neighbors_.size() > of_b.size();
    for (const int32_t v : beside_a) common += mark_[v] == now_;
    for (const int32_t t : of_b)
      if (!has(t, a)) changed.push_back(t);
    if (common != static_cast<int>(gone.size()) || (border_a && border_b && gone.size() == 2) || changed.empty()) return false;
    return !twins(changed, a, b);
  }

  // Whether two triangles differ by these vertices alone: they would be one.
  bool twins(const std::vector<int32_t>& changed, int32_t a, int32_t b) const {
    for (const int32_t s : changed)
      for (const int32_t t : changed) {
        if (!has(s, a) || !has(t, b)) continue;
        int equal = 0;
        for (int k = 0; k < 3; ++k) equal += has(t, triangle(s)[k]);
        if (equal == 2) return true;
      }
    return false;
  }

  bool keeps_shape(const Collapse& c, Vec3 x, const std::vector<int32_t>& changed) const {
    const auto shape = [](const Vec3* p) {
      const Vec3 e[3] = {p[1] - p[0], p[2] - p[1], p[0] - p[2]};
      return norm(cross(e[0], e[1])) / std::max({dot(e[0], e[0]), dot(e[1], e[1]), dot(e[2], e[2]), 1e-300});
    };
    for (const int32_t t : changed) {
      Vec3 old[3], now[3];
      for (int k = 0; k < 3; ++k) {
        const int32_t v = triangle(t)[k];
        old[k] = at(v), now[k] = v == c.a || v == c.b ? x : old[k];
      }
      const Vec3 before = cross(old[1] - old[0], old[2] - old[0]), after = cross(now[1] - now[0], now[2] - now[0]);
      if (!(dot(before, after) >= kTurn * norm(before) * norm(after)) || shape(now) < std::min(kSliver, shape(old))) return false;
    }
    return true;
  }

  // Moves the edge to a place, and back where a triangle meets another one then.
  bool keeps_apart(const Collapse& c, Vec3 x, const std::vector<int32_t>& gone, const std::vector<int32_t>& changed) {
    const Vec3 old = at(c.a);
    store(&vertices[3 * int64_t{c.a}], x);
    std::vector<int32_t> renamed;
    for (const int32_t t : changed) {
      changing_[t] = 1;
      for (int32_t h = 3 * t; h < 3 * t + 3; ++h)
        if (corners[h] == c.b) corners[h] = c.a, renamed.push_back(h);
    }
    for (const int32_t t : gone) dead_[t] = 1;
    bool meets = false;
    for (size_t i = 0; i < changed.size() && !meets; ++i) {
      const int32_t* own = triangle(changed[i]);
      const auto meet = [&](int32_t t) { return triangles_meet(vertices.data(), own, triangle(t)); };
      for (size_t j = 0; j < i && !meets; ++j) meets = meet(changed[j]);
      meets = meets || tree_.any_meeting(tree_.box(vertices.data(), own),
                                         [&](int32_t t) { return !dead_[t] && !changing_[t] && meet(t); });
    }
    for (const int32_t t : changed) changing_[t] = 0;
    if (!meets) return true;
    for (const int32_t t : gone) dead_[t] = 0;
    for (const int32_t h : renamed) corners[h] = c.b;
    store(&vertices[3 * int64_t{c.a}], old);
    return false;
  }
};

}  // namespace sofnn
