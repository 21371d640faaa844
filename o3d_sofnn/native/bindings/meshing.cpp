// SPDX-License-Identifier: MIT
#include "bindings/arrays.hpp"
#include "meshing/decimation.hpp"
#include "meshing/distance.hpp"
#include "meshing/dual_walk.hpp"
#include "meshing/handles.hpp"
#include "meshing/marching_cubes.hpp"
#include "meshing/mesh.hpp"
#include "meshing/triangle_tree.hpp"

namespace sofnn {

using namespace nb::literals;

using Signs = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Cubes = nb::ndarray<const int32_t, nb::shape<-1, 8>, nb::c_contig, nb::device::cpu>;
using Ends = nb::ndarray<const int64_t, nb::shape<12, 2>, nb::c_contig, nb::device::cpu>;
using Nudges = nb::ndarray<const double, nb::shape<2>, nb::c_contig, nb::device::cpu>;
using HalfEdgeList = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using CaseTriangles = nb::ndarray<const int64_t, nb::shape<2, 256, -1, 3>, nb::c_contig, nb::device::cpu>;
using CaseMembers = nb::ndarray<const int64_t, nb::shape<2, 256, 4, 12>, nb::c_contig, nb::device::cpu>;

constexpr int64_t kMostVertices = ((int64_t{1} << 31) - 1) / 3;  // half-edges and coordinates have 32-bit numbers

static MeshView view(const Points& vertices, const Triangles& triangles) {
  expect((int64_t)vertices.shape(0) <= kMostVertices && (int64_t)triangles.shape(0) <= kMostVertices,
         "triangles: expected at most 715,827,882 vertices and triangles");
  expect(all_below(triangles.data(), 3 * triangles.shape(0), vertices.shape(0)), "triangles: expected rows of vertices");
  return {vertices.data(), triangles.data(), (int64_t)vertices.shape(0), (int64_t)triangles.shape(0)};
}

static bool tables_fit(const CaseTriangles& triangles, const CaseMembers& members, const Ends& ends) {
  bool fit = all_below(ends.data(), 24, 8);
  for (size_t i = 0; i < triangles.size(); ++i) fit &= triangles.data()[i] >= -1 && triangles.data()[i] < 16;
  for (size_t i = 0; i < members.size(); ++i) fit &= members.data()[i] >= -1 && members.data()[i] < 12;
  // Where a row of corners begins it goes on.
  for (size_t i = 0; i < triangles.size(); i += 3)
    fit &= triangles.data()[i] < 0 || (triangles.data()[i + 1] >= 0 && triangles.data()[i + 2] >= 0);
  return fit;
}

void bind_meshing(nb::module_& m) {
  nb::class_<DualWalk>(m, "DualWalk")
      .def("__init__",
           [](DualWalk* w, Points points, Doubles origin, double size, Ints levels, int top, int threads) {
             expect(origin.shape(0) == 3 && levels.shape(0) == points.shape(0), "levels: expected one for each point");
             expect(top >= 0 && top < 21 && all_below(levels.data(), levels.shape(0), top + 1), "levels: expected 0 to top, below 21");
             expect(DualWalk::holds(points.data(), points.shape(0), origin.data(), size, top), "size: expected cells that fit 20 bits");
             nb::gil_scoped_release release;
             new (w) DualWalk(points.data(), points.shape(0), origin.data(), size, levels.data(), top, threads);
           },
           "points"_a, "origin"_a, "size"_a, "levels"_a, "top"_a, "n_threads"_a)
      .def("advance",
           [](DualWalk& w, Signs inside) {
             expect(inside.shape(0) + w.n_known() <= w.leaves().size(), "inside: expected one for each leaf that was wanted");
             std::vector<int64_t> wanted;
             {
               nb::gil_scoped_release release;
               wanted = w.advance(inside.data(), inside.shape(0));
             }
             const size_t n = wanted.size();
             return array(std::move(wanted), {n});
           },
           "inside"_a)
      .def("leaves", [](const DualWalk& w) { return array(std::vector<int64_t>(w.leaves()), {w.leaves().size()}); })
      .def("take_crossed", [](DualWalk& w) {
        std::vector<int32_t> corners = w.take_crossed();
        const size_t n = corners.size() / 8;
        return array(std::move(corners), {n, 8});
      });

  m.def("marching_cubes",
        [](Doubles values, Points nodes, Cubes cubes, CaseTriangles triangles, CaseMembers members, Ends ends, Nudges nudges) {
          expect(values.shape(0) == nodes.shape(0) && all_below(cubes.data(), 8 * cubes.shape(0), nodes.shape(0)),
                 "values, cubes: expected one value for each node, and rows of nodes");
          expect(tables_fit(triangles, members, ends), "triangles, members, ends: expected tables of cubes");
          CubeMesh mesh;
          {
            nb::gil_scoped_release release;
            const CubeTables tables{triangles.data(), members.data(), ends.data(), (int64_t)triangles.shape(2)};
            MarchingCubes walk(tables, values.data(), nodes.data(), nodes.shape(0), nudges.data());
            mesh = walk.triangulate(cubes.data(), cubes.shape(0));
          }
          const size_t n = mesh.vertices.size() / 3, t = mesh.triangles.size() / 3, k = mesh.uneven.size();
          return nb::make_tuple(array(std::move(mesh.vertices), {n, 3}), array(std::move(mesh.triangles), {t, 3}),
                                array(std::move(mesh.uneven), {k}), array(std::move(mesh.inner), {k, 3}));
        },
        "values"_a, "nodes"_a, "cubes"_a, "triangles"_a, "members"_a, "ends"_a, "nudges"_a);

  m.def("vertex_normals",
        [](Points vertices, Triangles triangles) {
          const MeshView mesh = view(vertices, triangles);
          std::vector<double> normals;
          {
            nb::gil_scoped_release release;
            normals = vertex_normals(mesh);
          }
          return array(std::move(normals), {vertices.shape(0), 3});
        },
        "vertices"_a, "triangles"_a);

  m.def("surroundings",
        [](Points vertices, Triangles triangles) {
          const size_t n = vertices.shape(0);
          const MeshView mesh = view(vertices, triangles);
          Surroundings s;
          {
            nb::gil_scoped_release release;
            s = surroundings(mesh);
          }
          return nb::make_tuple(array(std::move(s.normals), {n, 3}), array(std::move(s.ways), {n, 3}), array(std::move(s.lengths), {n}));
        },
        "vertices"_a, "triangles"_a);

  m.def("bent_vertices",
        [](Points vertices, Triangles triangles, Points normals, double least) {
          expect(normals.shape(0) == vertices.shape(0), "normals: expected one for each vertex");
          const MeshView mesh = view(vertices, triangles);
          std::vector<uint8_t> bent;
          {
            nb::gil_scoped_release release;
            bent = bent_vertices(mesh, normals.data(), least);
          }
          return array(std::move(bent), {vertices.shape(0)});
        },
        "vertices"_a, "triangles"_a, "normals"_a, "least"_a);

  m.def("undo_turns",
        [](Points before, Points after, Triangles triangles, double cosine) {
          expect(after.shape(0) == before.shape(0), "after: expected as many rows as before");
          const MeshView mesh = view(before, triangles);
          std::vector<double> moved;
          {
            nb::gil_scoped_release release;
            moved = undo_turns(mesh, after.data(), cosine);
          }
          return array(std::move(moved), {before.shape(0), 3});
        },
        "before"_a, "after"_a, "triangles"_a, "cosine"_a);

  m.def("intersecting_pairs",
        [](Points vertices, Triangles triangles, Signs suspect, int threads) {
          expect(suspect.shape(0) == triangles.shape(0), "suspect: expected one for each triangle");
          const MeshView mesh = view(vertices, triangles);
          std::vector<int32_t> pairs;
          {
            nb::gil_scoped_release release;
            pairs = intersecting_pairs(mesh, suspect.data(), threads);
          }
          const size_t n = pairs.size() / 2;
          return array(std::move(pairs), {n, 2});
        },
        "vertices"_a, "triangles"_a, "suspect"_a, "n_threads"_a);

  m.def("nearest_triangles",
        [](Points vertices, Triangles triangles, Points x, int threads) {
          const MeshView mesh = view(vertices, triangles);
          Nearest found;
          {
            nb::gil_scoped_release release;
            found = nearest_triangles(mesh, x.data(), x.shape(0), threads);
          }
          return nb::make_tuple(array(std::move(found.distance), {x.shape(0)}), array(std::move(found.triangle), {x.shape(0)}));
        },
        "vertices"_a, "triangles"_a, "x"_a, "n_threads"_a);

  m.def("decimate",
        [](Points vertices, Triangles triangles, int64_t target, int threads) {
          const MeshView mesh = view(vertices, triangles);
          std::vector<int32_t> source, corners;
          std::vector<double> places;
          {
            nb::gil_scoped_release release;
            Decimation fewer(mesh, threads);
            fewer.run(target);
            source = fewer.compact(), places.swap(fewer.vertices), corners.swap(fewer.corners);
          }
          const size_t n = source.size(), t = corners.size() / 3;
          return nb::make_tuple(array(std::move(places), {n, 3}), array(std::move(corners), {t, 3}), array(std::move(source), {n}));
        },
        "vertices"_a, "triangles"_a, "target"_a, "n_threads"_a);

  m.def("label_pieces",
        [](Triangles triangles, int64_t n) {
          expect(n >= 0 && n <= kMostVertices && all_below(triangles.data(), 3 * triangles.shape(0), n),
                 "triangles: expected rows of vertices");
          std::vector<int64_t> label;
          {
            nb::gil_scoped_release release;
            label = label_pieces(triangles.data(), triangles.shape(0), n);
          }
          return array(std::move(label), {(size_t)n});
        },
        "triangles"_a, "n_vertices"_a);

  m.def("handle_edges",
        [](Points vertices, Triangles triangles) {
          const MeshView mesh = view(vertices, triangles);
          const HalfEdges half(mesh.triangles, static_cast<int32_t>(3 * mesh.n_triangles), mesh.n_vertices);
          expect(all_below(half.twin.data(), half.twin.size(), half.twin.size()), "triangles: expected a closed mesh");
          std::vector<int32_t> edges;
          {
            nb::gil_scoped_release release;
            edges = handle_edges(mesh, half);
          }
          const size_t n = edges.size();
          return array(std::move(edges), {n});
        },
        "vertices"_a, "triangles"_a);

  m.def("open_handles",
        [](Points vertices, Triangles triangles, HalfEdgeList edges, Doubles radius, int64_t largest) {
          expect(radius.shape(0) == edges.shape(0) && all_below(edges.data(), edges.shape(0), 3 * triangles.shape(0)),
                 "edges, radius: expected half-edges of the triangles, and one radius for each");
          expect(largest > 0, "largest: expected at least one triangle");
          Surface surface(view(vertices, triangles), largest);
          expect(all_below(surface.twin.data(), surface.twin.size(), surface.twin.size()), "triangles: expected a closed mesh");
          {
            nb::gil_scoped_release release;
            open_handles(surface, edges.data(), radius.data(), edges.shape(0));
          }
          const size_t n = surface.source.size(), t = surface.corners.size() / 3;
          return nb::make_tuple(array(std::move(surface.vertices), {n, 3}), array(std::move(surface.corners), {t, 3}),
                                array(std::move(surface.source), {n}), array(std::move(surface.touched), {n}));
        },
        "vertices"_a, "triangles"_a, "edges"_a, "radius"_a, "largest"_a);
}

}  // namespace sofnn
