// SPDX-License-Identifier: MIT
#include "bindings/arrays.hpp"
#include "meshing/dual_walk.hpp"
#include "meshing/handles.hpp"
#include "meshing/marching_cubes.hpp"
#include "meshing/mesh.hpp"

namespace sofnn {

using namespace nb::literals;

using Signs = nb::ndarray<const bool, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Cubes = nb::ndarray<const int32_t, nb::shape<-1, 8>, nb::c_contig, nb::device::cpu>;
using Ends = nb::ndarray<const int64_t, nb::shape<12, 2>, nb::c_contig, nb::device::cpu>;
using HalfEdgeList = nb::ndarray<const int32_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using CaseTriangles = nb::ndarray<const int64_t, nb::shape<2, 256, -1, 3>, nb::c_contig, nb::device::cpu>;
using CaseMembers = nb::ndarray<const int64_t, nb::shape<2, 256, 4, 12>, nb::c_contig, nb::device::cpu>;

static MeshView view(const Points& vertices, const Triangles& triangles) {
  return {vertices.data(), triangles.data(), (int64_t)vertices.shape(0), (int64_t)triangles.shape(0)};
}

void bind_meshing(nb::module_& m) {
  nb::class_<DualWalk>(m, "DualWalk")
      .def("__init__",
           [](DualWalk* w, Points points, Doubles origin, double size, Ints levels, int top, int threads) {
             new (w) DualWalk(points.data(), points.shape(0), origin.data(), size, levels.data(), top, threads);
           },
           "points"_a, "origin"_a, "size"_a, "levels"_a, "top"_a, "n_threads"_a, nb::call_guard<nb::gil_scoped_release>())
      .def("advance",
           [](DualWalk& w, Signs inside) {
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
        [](Doubles values, Points nodes, Cubes cubes, CaseTriangles triangles, CaseMembers members, Ends ends, double nudge) {
          CubeMesh mesh;
          {
            nb::gil_scoped_release release;
            const CubeTables tables{triangles.data(), members.data(), ends.data(), (int64_t)triangles.shape(2)};
            MarchingCubes walk(tables, values.data(), nodes.data(), nodes.shape(0), nudge);
            for (size_t i = 0; i < cubes.shape(0); ++i) walk.add(cubes.data() + 8 * i);
            mesh = walk.take();
          }
          const size_t n = mesh.vertices.size() / 3, t = mesh.triangles.size() / 3;
          return nb::make_tuple(array(std::move(mesh.vertices), {n, 3}), array(std::move(mesh.triangles), {t, 3}));
        },
        "values"_a, "nodes"_a, "cubes"_a, "triangles"_a, "members"_a, "ends"_a, "nudge"_a);

  m.def("vertex_normals",
        [](Points vertices, Triangles triangles) {
          std::vector<double> normals;
          {
            nb::gil_scoped_release release;
            normals = vertex_normals(view(vertices, triangles));
          }
          return array(std::move(normals), {vertices.shape(0), 3});
        },
        "vertices"_a, "triangles"_a);

  m.def("surroundings",
        [](Points vertices, Triangles triangles) {
          const size_t n = vertices.shape(0);
          Surroundings s;
          {
            nb::gil_scoped_release release;
            s = surroundings(view(vertices, triangles));
          }
          return nb::make_tuple(array(std::move(s.normals), {n, 3}), array(std::move(s.ways), {n, 3}), array(std::move(s.lengths), {n}));
        },
        "vertices"_a, "triangles"_a);

  m.def("bent_vertices",
        [](Points vertices, Triangles triangles, Points normals, double least) {
          std::vector<uint8_t> bent;
          {
            nb::gil_scoped_release release;
            bent = bent_vertices(view(vertices, triangles), normals.data(), least);
          }
          return array(std::move(bent), {vertices.shape(0)});
        },
        "vertices"_a, "triangles"_a, "normals"_a, "least"_a);

  m.def("undo_turns",
        [](Points before, Points after, Triangles triangles, double cosine) {
          std::vector<double> moved;
          {
            nb::gil_scoped_release release;
            moved = undo_turns(view(before, triangles), after.data(), cosine);
          }
          return array(std::move(moved), {before.shape(0), 3});
        },
        "before"_a, "after"_a, "triangles"_a, "cosine"_a);

  m.def("label_pieces",
        [](Triangles triangles, int64_t n) {
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
          std::vector<int32_t> edges;
          {
            nb::gil_scoped_release release;
            edges = handle_edges(view(vertices, triangles));
          }
          const size_t n = edges.size();
          return array(std::move(edges), {n});
        },
        "vertices"_a, "triangles"_a);

  m.def("open_handles",
        [](Points vertices, Triangles triangles, HalfEdgeList edges, Doubles radius) {
          Surface surface(view(vertices, triangles));
          {
            nb::gil_scoped_release release;
            open_handles(surface, edges.data(), radius.data(), edges.shape(0));
          }
          const size_t n = surface.source.size(), t = surface.corners.size() / 3;
          return nb::make_tuple(array(std::move(surface.vertices), {n, 3}), array(std::move(surface.corners), {t, 3}),
                                array(std::move(surface.source), {n}), array(std::move(surface.touched), {n}));
        },
        "vertices"_a, "triangles"_a, "edges"_a, "radius"_a);
}

}  // namespace sofnn
