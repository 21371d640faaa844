// SPDX-License-Identifier: MIT
#include <nanobind/stl/optional.h>

#include "bindings/arrays.hpp"
#include "sampling/local_fit.hpp"
#include "sampling/sides.hpp"
#include "sampling/typical_data.hpp"

namespace sofnn {

using namespace nb::literals;

void bind_sampling(nb::module_& m) {
  m.def("fit_scales",
        [](const KdTree& t, Points p, Points centers, Ints scales) {
          const size_t n = centers.shape(0), ns = scales.shape(0);
          expect((int64_t)p.shape(0) == t.size(), "points: expected those of the tree");
          expect(ascending(scales, 1, kMostNeighbors, 0), "scales: expected ascending numbers from 1");
          std::vector<double> normal(n * ns * 3), residual(n * ns), radius(n * ns), variation(n * ns);
          {
            nb::gil_scoped_release release;
            parallel_for(n, 16, t.threads(), [&](int64_t lo, int64_t hi) {
              FitScratch s;
              for (int64_t i = lo; i < hi; ++i)
                fit_scales(t, p.data(), load(centers.data() + 3 * i), scales.data(), ns, s, [&](size_t j, const LocalFit& f) {
                  const size_t o = i * ns + j;
                  store(&normal[3 * o], f.normal);
                  residual[o] = f.residual, radius[o] = f.radius, variation[o] = f.surface_variation;
                });
            });
          }
          return nb::make_tuple(array(std::move(normal), {n, ns, 3}), array(std::move(residual), {n, ns}),
                                array(std::move(radius), {n, ns}), array(std::move(variation), {n, ns}));
        },
        "tree"_a, "points"_a, "centers"_a, "scales"_a);

  m.def("fit_quadrics",
        [](const KdTree& t, Points p, Points centers, Ints neighbors, Doubles robust, int iterations,
           std::optional<Points> normals, std::optional<Points> sides, std::optional<Points> across, Doubles stretch) {
          const size_t n = centers.shape(0), np = t.size();
          expect(p.shape(0) == np && (!normals || normals->shape(0) == np), "points, normals: expected those of the tree");
          expect(neighbors.shape(0) == n && robust.shape(0) == n && stretch.shape(0) == n && (!sides || sides->shape(0) == n) &&
                     (!across || across->shape(0) == n) && !(normals && !sides) && !(across && !sides),
                 "n_neighbors, robust, sides, across, stretch: expected one row for each centre");
          expect(all_below(neighbors.data(), n, kMostNeighbors), "n_neighbors: expected 0 to 2**31 - 1");
          std::vector<double> frame(9 * n), coefficients(6 * n), residual(n), radius(n), support(n);
          {
            nb::gil_scoped_release release;
            const FitData data{t, p.data(), normals ? normals->data() : nullptr};
            parallel_for(n, 64, t.threads(), [&](int64_t lo, int64_t hi) {
              FitScratch s;
              for (int64_t i = lo; i < hi; ++i) {
                const FitRequest wanted{load(centers.data() + 3 * i), sides ? sides->data() + 3 * i : nullptr,
                                        across ? across->data() + 3 * i : nullptr, stretch.data()[i],
                                        neighbors.data()[i], robust.data()[i], iterations};
                const LocalFit f = fit_around(data, wanted, s);
                store(&frame[9 * i], f.frame.t1), store(&frame[9 * i + 3], f.frame.t2), store(&frame[9 * i + 6], f.frame.n);
                std::copy(f.coefficients, f.coefficients + 6, &coefficients[6 * i]);
                residual[i] = f.residual, radius[i] = f.radius, support[i] = f.support;
              }
            });
          }
          return nb::make_tuple(array(std::move(frame), {n, 3, 3}), array(std::move(coefficients), {n, 6}),
                                array(std::move(residual), {n}), array(std::move(radius), {n}), array(std::move(support), {n}));
        },
        "tree"_a, "points"_a, "centers"_a, "n_neighbors"_a, "robust"_a, "iterations"_a, "normals"_a.none(), "sides"_a.none(),
        "across"_a.none(), "stretch"_a);

  m.def("typical_data",
        [](Points p, Ints offsets, Ints clusters, int iterations, double tolerance, int threads) {
          expect(ascending(offsets, 0, p.shape(0), 1), "offsets: expected ascending rows of points");
          const size_t cells = offsets.shape(0) - 1;
          expect(clusters.shape(0) == cells, "n_clusters: expected one for each cell");
          for (size_t i = 0; i < cells; ++i)
            expect(clusters.data()[i] > 0 && clusters.data()[i] <= offsets.data()[i + 1] - offsets.data()[i],
                   "n_clusters: expected 1 to the number of points of the cell");
          std::vector<int64_t> first(cells + 1, 0);
          for (size_t i = 0; i < cells; ++i) first[i + 1] = first[i] + clusters.data()[i];
          std::vector<double> centers(3 * first[cells]);
          {
            nb::gil_scoped_release release;
            parallel_for(cells, 64, threads, [&](int64_t lo, int64_t hi) {
              std::vector<double> scratch;
              for (int64_t i = lo; i < hi; ++i)
                cluster_cell(p.data() + 3 * offsets.data()[i], offsets.data()[i + 1] - offsets.data()[i], clusters.data()[i],
                             iterations, tolerance, &centers[3 * first[i]], scratch);
            });
          }
          return array(std::move(centers), {(size_t)first[cells], 3});
        },
        "points"_a, "offsets"_a, "n_clusters"_a, "iterations"_a, "tolerance"_a, "n_threads"_a);

  m.def("divide_cells",
        [](Points normals, Ints first, int threads) {
          expect(ascending(first, 0, normals.shape(0), 1) && first.data()[0] == 0 &&
                     first.data()[first.shape(0) - 1] == (int64_t)normals.shape(0),
                 "first: expected ascending rows, 0 and the number of normals at the ends");
          const size_t cells = first.shape(0) - 1;
          std::vector<int64_t> order(normals.shape(0)), size(cells);
          {
            nb::gil_scoped_release release;
            divide_cells(normals.data(), first.data(), cells, threads, order.data(), size.data());
          }
          return nb::make_tuple(array(std::move(order), {normals.shape(0)}), array(std::move(size), {cells}));
        },
        "normals"_a, "first"_a, "n_threads"_a);
}

}  // namespace sofnn
