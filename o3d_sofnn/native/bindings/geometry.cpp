// SPDX-License-Identifier: MIT
#include "bindings/arrays.hpp"
#include "geometry/kdtree.hpp"
#include "geometry/morton.hpp"

namespace sofnn {

using namespace nb::literals;

void bind_geometry(nb::module_& m) {
  nb::class_<KdTree>(m, "KdTree")
      .def_prop_ro("size", &KdTree::size)
      .def("__init__", [](KdTree* t, Points p, int threads) { new (t) KdTree(p.data(), p.shape(0), threads); },
           "points"_a, "n_threads"_a, nb::call_guard<nb::gil_scoped_release>())
      .def("query",
           [](const KdTree& t, Points x, int64_t k, double max_distance) {
             const size_t n = x.shape(0);
             expect(k > 0 && k < kMostNeighbors, kNeighborsWanted);
             std::vector<double> dist(n * k, std::numeric_limits<double>::infinity());
             std::vector<int64_t> index(n * k, t.size());
             {
               nb::gil_scoped_release release;
               parallel_for(n, 256, t.threads(), [&](int64_t lo, int64_t hi) {
                 Search s;
                 for (int64_t i = lo; i < hi; ++i) {
                   t.nearest_sorted(load(x.data() + 3 * i), k, max_distance * max_distance, s);
                   for (int64_t j = 0; j < s.size(); ++j)
                     dist[i * k + j] = std::sqrt(s[j].sq_dist), index[i * k + j] = s[j].index;
                 }
               });
             }
             return nb::make_tuple(array(std::move(dist), {n, (size_t)k}), array(std::move(index), {n, (size_t)k}));
           },
           "x"_a, "k"_a, "max_distance"_a)
      .def("crowded",
           [](const KdTree& t, Points x, int64_t k, Doubles distance) {
             const size_t n = x.shape(0);
             expect(distance.shape(0) == n, "distance: expected one for each row of x");
             std::vector<uint8_t> result(n);
             {
               nb::gil_scoped_release release;
               parallel_for(n, 1024, t.threads(), [&](int64_t lo, int64_t hi) {
                 for (int64_t i = lo; i < hi; ++i)
                   result[i] = t.crowded(load(x.data() + 3 * i), k, distance.data()[i] * distance.data()[i]);
               });
             }
             return array(std::move(result), {n});
           },
           "x"_a, "k"_a, "distance"_a);

  m.def("sort_morton",
        [](Points p, int threads) {
          const size_t n = p.shape(0);
          std::vector<uint64_t> keys(n);
          std::vector<int64_t> order(n);
          {
            nb::gil_scoped_release release;
            const std::vector<MortonEntry> entries = sort_morton(p.data(), n, threads);
            for (size_t i = 0; i < n; ++i) keys[i] = entries[i].key, order[i] = entries[i].index;
          }
          return nb::make_tuple(array(std::move(keys), {n}), array(std::move(order), {n}));
        },
        "points"_a, "n_threads"_a);
}

}  // namespace sofnn
