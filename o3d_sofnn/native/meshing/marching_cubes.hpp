// SPDX-License-Identifier: MIT
// Triangles of the zero set on a list of cubes, from the tables of marching_cubes.py.
#pragma once
#include <algorithm>

#include "geometry/hash.hpp"
#include "geometry/linalg.hpp"

namespace sofnn {

// Tables for cubes with different corners and, after those, for cubes with corners that coincide: triangles
// (2, 256, slots, 3) of edges 0 to 11 and middles 12 to 15, -1 for none; edges (2, 256, 4, 12) around each middle.
struct CubeTables {
  const int64_t *triangles, *members, *edge_ends;
  int64_t slots;
};

struct CubeMesh {
  std::vector<double> vertices;
  std::vector<int32_t> triangles;
  std::vector<int32_t> uneven;  // vertices beside cubes with corners that coincide,
  std::vector<double> inner;    // and their places farther from the nodes
};

class MarchingCubes {
 public:
  // Vertices stay away from the nodes by nudges[0] of the edge. On edges of cubes with corners that coincide they have a
  // second place, away by nudges[1].
  MarchingCubes(const CubeTables& tables, const double* values, const double* nodes, int64_t n_nodes, const double* nudges)
      : tables_(tables), values_(values), nodes_(nodes), n_(n_nodes), nudges_{nudges[0], nudges[1]} {}

  CubeMesh triangulate(const int32_t* cubes, int64_t count) {
    for (int64_t i = 0; i < count; ++i)
      if (coincide(cubes + 8 * i))
        for (int e = 0; e < 12; ++e) uneven_.insert(key(cubes + 8 * i, e), 0);
    for (int64_t i = 0; i < count; ++i) add(cubes + 8 * i);
    return std::move(mesh_);
  }

 private:
  static constexpr int64_t kMiddle = 12;
  CubeTables tables_;
  const double *values_, *nodes_;
  int64_t n_;
  double nudges_[2];
  KeyMap known_, uneven_;
  CubeMesh mesh_;

  bool coincide(const int32_t* cube) const {
    bool found = false;
    for (int e = 0; e < 12; ++e) found |= cube[tables_.edge_ends[2 * e]] == cube[tables_.edge_ends[2 * e + 1]];
    return found;
  }

  void add(const int32_t* cube) {
    int code = 0;
    for (int c = 0; c < 8; ++c) code |= (values_[cube[c]] < 0) << c;
    if (code == 0 || code == 255) return;
    const bool fan = coincide(cube);
    const int64_t row = 256 * fan + code;
    const int64_t* local = tables_.triangles + 3 * tables_.slots * row;
    const int64_t* members = tables_.members + 48 * row;
    int fan_size[4] = {0, 0, 0, 0};
    if (fan)
      for (int64_t t = 0; t < tables_.slots && local[3 * t] >= 0; ++t)
        if (local[3 * t] >= kMiddle && whole(cube, local + 3 * t)) ++fan_size[local[3 * t] - kMiddle];
    int32_t middle[4] = {-1, -1, -1, -1};
    for (int64_t t = 0; t < tables_.slots && local[3 * t] >= 0; ++t) {
      const int64_t* triangle = local + 3 * t;
      // What has collapsed is dropped, and fans of which less than three triangles are left.
      if (fan && (!whole(cube, triangle) || (triangle[0] >= kMiddle && fan_size[triangle[0] - kMiddle] < 3))) continue;
      for (int k = 0; k < 3; ++k) {
        if (triangle[k] < kMiddle) {
          mesh_.triangles.push_back(edge_vertex(cube, triangle[k]));
          continue;
        }
        int32_t& known = middle[triangle[k] - kMiddle];
        if (known < 0) known = middle_vertex(cube, members + 12 * (triangle[k] - kMiddle));
        mesh_.triangles.push_back(known);
      }
    }
  }

  // An edge is named by its nodes, the lower one first.
  int64_t key(const int32_t* cube, int64_t edge) const {
    const int64_t a = cube[tables_.edge_ends[2 * edge]], b = cube[tables_.edge_ends[2 * edge + 1]];
    return std::min(a, b) * n_ + std::max(a, b);
  }

  bool whole(const int32_t* cube, const int64_t* triangle) const {
    int64_t name[3];
    for (int k = 0; k < 3; ++k) name[k] = triangle[k] < kMiddle ? key(cube, triangle[k]) : -triangle[k];
    return name[0] != name[1] && name[1] != name[2] && name[2] != name[0];
  }

  // Where the function changes its sign along an edge, over its length: first and second place.
  struct Crossing {
    double first, second;
  };

  Crossing crossing(int64_t key) const {
    const int64_t a = key / n_, b = key % n_;
    // In this order what is no number becomes the nudge.
    const double first = std::min(1 - nudges_[0], std::max(nudges_[0], values_[a] / (values_[a] - values_[b])));
    return {first, uneven_.find(key) < 0 ? first : std::min(std::max(first, nudges_[1]), 1 - nudges_[1])};
  }

  Vec3 place(int64_t key, double t) const {
    const Vec3 start = load(nodes_ + 3 * (key / n_));
    return start + t * (load(nodes_ + 3 * (key % n_)) - start);
  }

  int32_t append(Vec3 x) {
    mesh_.vertices.insert(mesh_.vertices.end(), {x.x, x.y, x.z});
    return static_cast<int32_t>(mesh_.vertices.size() / 3 - 1);
  }

  void second_place(int32_t vertex, Vec3 x) {
    mesh_.uneven.push_back(vertex);
    mesh_.inner.insert(mesh_.inner.end(), {x.x, x.y, x.z});
  }

  int32_t edge_vertex(const int32_t* cube, int64_t edge) {
    const int64_t name = key(cube, edge), next = static_cast<int64_t>(mesh_.vertices.size() / 3);
    const int64_t index = known_.insert(name, next);
    if (index != next) return static_cast<int32_t>(index);
    const Crossing t = crossing(name);
    if (t.first != t.second) second_place(static_cast<int32_t>(next), place(name, t.second));
    return append(place(name, t.first));
  }

  int32_t middle_vertex(const int32_t* cube, const int64_t* loop) {
    Vec3 first{0, 0, 0}, second{0, 0, 0};
    bool differ = false;
    int count = 0;
    for (; count < 12 && loop[count] >= 0; ++count) {
      const int64_t name = key(cube, loop[count]);
      const Crossing t = crossing(name);
      first = first + place(name, t.first), second = second + place(name, t.second), differ |= t.first != t.second;
    }
    const int32_t index = append((1.0 / count) * first);
    if (differ) second_place(index, (1.0 / count) * second);
    return index;
  }
};

}  // namespace sofnn
