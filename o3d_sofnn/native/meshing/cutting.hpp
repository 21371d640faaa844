// SPDX-License-Identifier: MIT
// A closed mesh that is cut along loops of half-edges.
#pragma once
#include <array>

#include "meshing/mesh.hpp"

namespace sofnn {

// Half-edges by the vertex that they leave, and the twin of each.
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

// A closed mesh that changes where it is cut.
struct Surface {
  std::vector<double> vertices;
  std::vector<int32_t> corners, twin, source;  // source: the vertex that each one was, or is near to
  std::vector<uint8_t> touched;                // vertices on cuts
  size_t largest;                              // most triangles of a patch
  std::vector<int32_t> index;                  // place of triangles in the patch that is looked at, -1 elsewhere

  Surface(const MeshView& mesh, int64_t most)
      : vertices(mesh.vertices, mesh.vertices + 3 * mesh.n_vertices),
        corners(mesh.triangles, mesh.triangles + 3 * mesh.n_triangles),
        twin(HalfEdges(mesh.triangles, static_cast<int32_t>(corners.size()), mesh.n_vertices).twin),
        source(mesh.n_vertices),
        touched(mesh.n_vertices, 0),
        largest(static_cast<size_t>(most)),
        index(mesh.n_triangles, -1) {
    std::iota(source.begin(), source.end(), 0);
  }

  Vec3 vertex(int32_t i) const { return load(&vertices[3 * int64_t{i}]); }
  int32_t end(int32_t h) const { return corners[following(h)]; }

  // Triangles that hang together with that of a half-edge, with their middles in a ball around its own middle: the first
  // `largest` of them, ring by ring.
  std::vector<int32_t> patch(int32_t h, double radius) {
    const Vec3 middle = 0.5 * (vertex(corners[h]) + vertex(end(h)));
    std::vector<int32_t> rows{h / 3};
    index[h / 3] = 0;
    for (size_t i = 0; i < rows.size(); ++i)
      for (int32_t g = 3 * rows[i]; g < 3 * rows[i] + 3; ++g) {
        const int32_t t = twin[g] / 3;
        const Vec3 sum = vertex(corners[3 * t]) + vertex(corners[3 * t + 1]) + vertex(corners[3 * t + 2]);
        if (index[t] >= 0 || rows.size() == largest || norm((1.0 / 3.0) * sum - middle) >= radius) continue;
        index[t] = static_cast<int32_t>(rows.size()), rows.push_back(t);
      }
    return rows;
  }

  // Cuts along a loop of half-edges. The left side gets new vertices, and both sides a lid.
  void cut(const std::vector<int32_t>& loop) {
    const auto n = static_cast<int32_t>(loop.size()), first = static_cast<int32_t>(source.size());
    std::vector<int32_t> names, right, left;
    std::vector<std::pair<int32_t, int32_t>> renamed;
    for (int32_t i = 0; i < n; ++i) {
      names.push_back(corners[loop[i]]), left.push_back(first + i), right.push_back(twin[loop[i]]);
      // Around the vertex on the left, from the edge ahead to the one behind.
      const int32_t behind = loop[(i + n - 1) % n];
      for (int32_t h = loop[i];; h = twin[following(following(h))]) {
        renamed.push_back({h, first + i});
        if (following(following(h)) == behind) break;
      }
    }
    for (const auto& [h, name] : renamed) corners[h] = name;
    for (const int32_t v : names) append(vertex(v), v);
    if (n == 3) {
      lid({left[2], left[1], left[0]}, {loop[1], loop[0], loop[2]});
      lid({names[0], names[1], names[2]}, {right[0], right[1], right[2]});
      return;
    }
    Vec3 sum{0, 0, 0};
    for (const int32_t v : names) sum = sum + vertex(v);
    const int32_t peak = first + n;
    for (int side = 0; side < 2; ++side) append((1.0 / n) * sum, names[0]);
    const auto base = static_cast<int32_t>(corners.size());
    for (int32_t i = 0; i < n; ++i) {
      const int32_t next = (i + 1) % n, before = (i + n - 1) % n;
      lid({peak, left[next], left[i]}, {base + 6 * next + 2, loop[i], base + 6 * before});
      lid({peak + 1, names[i], names[next]}, {base + 6 * before + 5, right[i], base + 6 * next + 3});
    }
  }

 private:
  void append(Vec3 x, int32_t like) {
    vertices.insert(vertices.end(), {x.x, x.y, x.z});
    source.push_back(source[like]), touched[like] = 1, touched.push_back(1);
  }

  void lid(std::array<int32_t, 3> names, std::array<int32_t, 3> twins) {
    const auto h = static_cast<int32_t>(corners.size());
    corners.insert(corners.end(), names.begin(), names.end());
    twin.insert(twin.end(), twins.begin(), twins.end());
    index.push_back(-1);
    for (int32_t k = 0; k < 3; ++k)
      if (twins[k] < h) twin[twins[k]] = h + k;
  }
};

}  // namespace sofnn
