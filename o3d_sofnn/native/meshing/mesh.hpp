// SPDX-License-Identifier: MIT
// Loops over the triangles of a mesh: normals, even triangles, connected pieces.
#pragma once
#include <algorithm>
#include <numeric>
#include <vector>

#include "geometry/linalg.hpp"

namespace sofnn {

struct MeshView {
  const double* vertices;
  const int32_t* triangles;
  int64_t n_vertices, n_triangles;

  Vec3 vertex(int64_t i) const { return load(vertices + 3 * i); }
};

// Half-edge 3 t + k goes from corner k of triangle t to the next one.
template <class Index>
Index following(Index h) {
  return h % 3 < 2 ? h + 1 : h - 2;
}

// Sets of numbers that grow together; the least number of a set is its root.
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

inline Vec3 area_vector(const double* vertices, const int32_t* t) {
  const Vec3 a = load(vertices + 3 * t[0]);
  return 0.5 * cross(load(vertices + 3 * t[1]) - a, load(vertices + 3 * t[2]) - a);
}

// Normals of the vertices: the mean over their triangles by area.
inline std::vector<double> vertex_normals(const MeshView& mesh) {
  std::vector<double> normals(3 * mesh.n_vertices, 0.0);
  for (int64_t i = 0; i < mesh.n_triangles; ++i) {
    const int32_t* t = mesh.triangles + 3 * i;
    const Vec3 area = area_vector(mesh.vertices, t);
    for (int k = 0; k < 3; ++k) {
      double* n = &normals[3 * t[k]];
      n[0] += area.x, n[1] += area.y, n[2] += area.z;
    }
  }
  for (int64_t i = 0; i < mesh.n_vertices; ++i) store(&normals[3 * i], unit(load(&normals[3 * i])));
  return normals;
}

// For each vertex of a closed mesh: its normal, the way to the middle of its neighbours within the tangent plane, and
// the mean length of its edges.
struct Surroundings {
  std::vector<double> normals, ways, lengths;
};

inline Surroundings surroundings(const MeshView& mesh) {
  Surroundings s{vertex_normals(mesh), std::vector<double>(3 * mesh.n_vertices, 0.0),
                 std::vector<double>(mesh.n_vertices, 0.0)};
  std::vector<int32_t> count(mesh.n_vertices, 0);
  // Each edge is met once in each direction, so the followers of a vertex are its neighbours.
  for (int64_t i = 0; i < 3 * mesh.n_triangles; ++i) {
    const int32_t a = mesh.triangles[i], b = mesh.triangles[following(i)];
    const Vec3 edge = mesh.vertex(b) - mesh.vertex(a);
    double* way = &s.ways[3 * a];
    way[0] += edge.x, way[1] += edge.y, way[2] += edge.z;
    s.lengths[a] += norm(edge), ++count[a];
  }
  for (int64_t i = 0; i < mesh.n_vertices; ++i) {
    const Vec3 normal = load(&s.normals[3 * i]);
    const double inv = 1.0 / std::max(count[i], 1);
    const Vec3 way = inv * load(&s.ways[3 * i]);
    store(&s.ways[3 * i], way - dot(way, normal) * normal);
    s.lengths[i] *= inv;
  }
  return s;
}

// Whether a triangle of a vertex leans away from its normal so far that the cosine is below a least one.
inline std::vector<uint8_t> bent_vertices(const MeshView& mesh, const double* normals, double least) {
  std::vector<uint8_t> bent(mesh.n_vertices, 0);
  for (int64_t i = 0; i < mesh.n_triangles; ++i) {
    const int32_t* t = mesh.triangles + 3 * i;
    const Vec3 facing = unit(area_vector(mesh.vertices, t));
    for (int k = 0; k < 3; ++k) bent[t[k]] |= dot(facing, load(normals + 3 * t[k])) < least;
  }
  return bent;
}

// Takes back the moves of vertices whose triangles would turn by more than a cosine, until none does.
inline std::vector<double> undo_turns(const MeshView& before, const double* after, double cosine) {
  std::vector<double> moved(after, after + 3 * before.n_vertices);
  std::vector<Vec3> facing(before.n_triangles);
  for (int64_t i = 0; i < before.n_triangles; ++i)
    facing[i] = unit(area_vector(before.vertices, before.triangles + 3 * i));
  std::vector<uint8_t> at_new_place(before.n_vertices, 1);
  std::vector<int32_t> turned;
  do {
    turned.clear();
    for (int64_t i = 0; i < before.n_triangles; ++i) {
      const int32_t* t = before.triangles + 3 * i;
      const Vec3 now = area_vector(moved.data(), t);
      if (dot(facing[i], unit(now)) >= cosine) continue;
      bool stays = true;
      for (int k = 0; k < 3; ++k) stays &= !at_new_place[t[k]];
      if (!stays) turned.insert(turned.end(), t, t + 3);
    }
    for (const int32_t v : turned) std::copy_n(before.vertices + 3 * int64_t{v}, 3, &moved[3 * int64_t{v}]), at_new_place[v] = 0;
  } while (!turned.empty());
  return moved;
}

// Number of the connected piece of each vertex, in the order of their first vertices.
inline std::vector<int64_t> label_pieces(const int32_t* triangles, int64_t n_triangles, int64_t n_vertices) {
  Unions pieces(n_vertices);
  for (int64_t i = 0; i < n_triangles; ++i)
    for (int k = 1; k < 3; ++k) pieces.join(triangles[3 * i], triangles[3 * i + k]);
  std::vector<int64_t> label(n_vertices);
  int64_t count = 0;
  for (int64_t i = 0; i < n_vertices; ++i) {  // the root of a piece is its first vertex
    const int32_t first = pieces.root(static_cast<int32_t>(i));
    label[i] = first == i ? count++ : label[first];
  }
  return label;
}

}  // namespace sofnn
