// SPDX-License-Identifier: MIT
#include <nanobind/stl/optional.h>

#include "arrays.hpp"
#include "local_fit.hpp"
#include "field.hpp"
#include "inference.hpp"
#include "morton.hpp"
#include "rlps.hpp"
#include "sides.hpp"
#include "typical_data.hpp"
#include "units.hpp"

using namespace nb::literals;
using namespace sofnn;

using Frames = nb::ndarray<const double, nb::shape<-1, 3, 3>, nb::c_contig, nb::device::cpu>;
using Coefficients = nb::ndarray<const double, nb::shape<-1, 6>, nb::c_contig, nb::device::cpu>;
using Gates = nb::ndarray<const double, nb::shape<-1, -1, 2>, nb::c_contig, nb::device::cpu>;
using Neurons = nb::ndarray<const double, nb::shape<-1, 3, 3>, nb::c_contig, nb::device::cpu>;
using Terms = nb::ndarray<const double, nb::shape<-1, -1, 4>, nb::c_contig, nb::device::cpu>;

NB_MODULE(_kernels, m) {
  bind_mesh(m);
  bind_winding(m);

  nb::class_<KdTree>(m, "KdTree")
      .def_prop_ro("size", &KdTree::size)
      .def("__init__", [](KdTree* t, Points p, int threads) { new (t) KdTree(p.data(), p.shape(0), threads); },
           "points"_a, "n_threads"_a, nb::call_guard<nb::gil_scoped_release>())
      .def("query",
           [](const KdTree& t, Points x, int64_t k, double max_distance, int threads) {
             const size_t n = x.shape(0);
             std::vector<double> dist(n * k, std::numeric_limits<double>::infinity());
             std::vector<int64_t> index(n * k, t.size());
             {
               nb::gil_scoped_release release;
               parallel_for(n, 256, threads, [&](int64_t lo, int64_t hi) {
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
           "x"_a, "k"_a, "max_distance"_a, "n_threads"_a)
      .def("crowded",
           [](const KdTree& t, Points x, int64_t k, Doubles distance, int threads) {
             const size_t n = x.shape(0);
             std::vector<uint8_t> result(n);
             {
               nb::gil_scoped_release release;
               parallel_for(n, 1024, threads, [&](int64_t lo, int64_t hi) {
                 for (int64_t i = lo; i < hi; ++i)
                   result[i] = t.crowded(load(x.data() + 3 * i), k, distance.data()[i] * distance.data()[i]);
               });
             }
             return array(std::move(result), {n});
           },
           "x"_a, "k"_a, "distance"_a, "n_threads"_a);

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

  m.def("fit_scales",
        [](const KdTree& t, Points p, Points centers, Ints scales, int threads) {
          const size_t n = centers.shape(0), ns = scales.shape(0);
          std::vector<double> normal(n * ns * 3), info(n * ns * 4);
          {
            nb::gil_scoped_release release;
            parallel_for(n, 16, threads, [&](int64_t lo, int64_t hi) {
              FitScratch s;
              std::vector<double> sq_radius(ns);
              for (int64_t i = lo; i < hi; ++i) {
                const Vec3 c = load(centers.data() + 3 * i);
                t.nearest(c, scales.data()[ns - 1], 1e300, s.neighbors);
                s.neighbors.nest(scales.data(), ns, sq_radius.data());
                load_points(p.data(), nullptr, nullptr, 0.0, c, s);
                for (size_t j = 0; j < ns; ++j) {
                  const int64_t k = std::min<int64_t>(scales.data()[j], s.neighbors.size());
                  const LocalFit f = fit_quadric(c, k, sq_radius[j], {}, 0.0, 0, s);
                  const size_t o = i * ns + j;
                  store(&normal[3 * o], f.normal);
                  info[4 * o] = f.rms, info[4 * o + 1] = f.slope_error, info[4 * o + 2] = f.radius, info[4 * o + 3] = f.surface_variation;
                }
              }
            });
          }
          return nb::make_tuple(array(std::move(normal), {n, ns, 3}), array(std::move(info), {n, ns, 4}));
        },
        "tree"_a, "points"_a, "centers"_a, "scales"_a, "n_threads"_a);

  m.def("fit_rules",
        [](const KdTree& t, Points p, Points centers, Ints neighbors, Doubles robust, int iterations,
           std::optional<Points> normals, std::optional<Points> sides, std::optional<Points> across, Doubles stretch, int threads) {
          const size_t n = centers.shape(0);
          std::vector<double> foot(3 * n), frame(9 * n), coef(6 * n), info(5 * n);
          {
            nb::gil_scoped_release release;
            parallel_for(n, 64, threads, [&](int64_t lo, int64_t hi) {
              FitScratch s;
              for (int64_t i = lo; i < hi; ++i) {
                const Vec3 c = load(centers.data() + 3 * i);
                Ellipse ellipse;
                if (across) {
                  ellipse.stretch = stretch.data()[i], ellipse.across = load(across->data() + 3 * i);
                  ellipse.along = unit(cross(load(sides->data() + 3 * i), ellipse.across));
                }
                const auto k = static_cast<int64_t>(std::lround(neighbors.data()[i] * ellipse.stretch));
                t.nearest(c, k, 1e300, s.neighbors);
                load_points(p.data(), normals ? normals->data() : nullptr, sides ? sides->data() + 3 * i : nullptr, robust.data()[i], c, s);
                const LocalFit f = fit_quadric(c, s.neighbors.size(), s.neighbors.sq_radius(), ellipse, robust.data()[i], iterations, s);
                store(&foot[3 * i], f.foot);
                store(&frame[9 * i], f.frame.t1), store(&frame[9 * i + 3], f.frame.t2), store(&frame[9 * i + 6], f.frame.n);
                for (int q = 0; q < 6; ++q) coef[6 * i + q] = f.coefficients[q];
                const double what[5] = {f.rms, f.slope_error, f.radius, f.surface_variation, f.support};
                std::copy_n(what, 5, &info[5 * i]);
              }
            });
          }
          return nb::make_tuple(array(std::move(foot), {n, 3}), array(std::move(frame), {n, 3, 3}), array(std::move(coef), {n, 6}), array(std::move(info), {n, 5}));
        },
        "tree"_a, "points"_a, "centers"_a, "n_neighbors"_a, "robust"_a, "iterations"_a, "normals"_a.none(), "sides"_a.none(), "across"_a.none(), "stretch"_a, "n_threads"_a);

  nb::class_<RuleView>(m, "RuleView")
      .def_prop_ro("size", [](const RuleView& v) { return v.rules.size(); })
      .def("__init__",
           [](RuleView* v, Points centers, Frames frames, Coefficients coef, Doubles radius, Doubles stretch, Doubles tolerance, Doubles quality,
              std::optional<Gates> gates, std::optional<Neurons> neurons, int threads) {
             const size_t n = centers.shape(0), m = neurons ? neurons->shape(0) : 0;
             if (m > kNeurons || (gates ? gates->shape(1) : 0) != m || (gates && gates->shape(0) != n))
               throw nb::value_error("gates and neurons: expected the same number of neurons, at most 8, or neither");
             new (v) RuleView(centers.data(), frames.data(), coef.data(), radius.data(), stretch.data(), tolerance.data(), quality.data(),
                              gates ? gates->data() : nullptr, neurons ? neurons->data() : nullptr, m, n, threads);
           },
           "centers"_a, "frames"_a, "coefficients"_a, "radius"_a, "stretch"_a, "tolerance"_a, "quality"_a, "gates"_a.none(), "neurons"_a.none(), "n_threads"_a, nb::call_guard<nb::gil_scoped_release>());

  m.def("infer_normals",
        [](const RuleView& rules, Points x, std::optional<Points> sides, int64_t k, int threads) {
          const size_t n = x.shape(0);
          std::vector<double> normal(3 * n), info(2 * n);
          {
            nb::gil_scoped_release release;
            const Places places(rules, x.data(), sides ? sides->data() : nullptr, n, k, threads);
            parallel_for(n, 256, threads, [&](int64_t lo, int64_t hi) {
              InferenceScratch s;
              infer_runs(rules, places.x(lo), places.sides(lo), hi - lo, k, s,
                         [&](int64_t first) { run_normals(s, &normal[3 * (lo + first)], &info[2 * (lo + first)]); });
            });
            normal = places.restore(std::move(normal), 3), info = places.restore(std::move(info), 2);
          }
          return nb::make_tuple(array(std::move(normal), {n, 3}), array(std::move(info), {n, 2}));
        },
        "rules"_a, "x"_a, "sides"_a.none(), "k"_a, "n_threads"_a);

  m.def("reconstruct_units",
        [](const KdTree& t, Points p, Points normals, const RuleView& rules, Ints neighbors, Ints own, Doubles tolerance, int threads) {
          const size_t n = rules.rules.size();
          std::vector<double> rbf(n * kTerms * 4, 0.0), error(n), worst(3 * n);
          std::vector<int64_t> terms(n);
          {
            nb::gil_scoped_release release;
            parallel_for(n, 64, threads, [&](int64_t lo, int64_t hi) {
              Search near;
              std::vector<UnitPoint> unit;
              for (int64_t i = lo; i < hi; ++i) {
                const Rule& rule = rules.rules[i];
                const Frame& f = rule.frame;
                const double r = rule.radius;
                unit_points(t, p.data(), normals.data(), rule, neighbors.data()[i], own.data()[i], near, unit);
                const LocalSurface s = reconstruct_unit(unit, rule.coefficients, tolerance.data()[i] / r);
                for (int k = 0; k < s.terms; ++k) {
                  for (int d = 0; d < 3; ++d) rbf[4 * (i * kTerms + k) + d] = s.term[k][d];
                  rbf[4 * (i * kTerms + k) + 3] = s.term[k][3];
                }
                terms[i] = s.terms, error[i] = s.error * r;
                store(&worst[3 * i], rule.center + r * (s.worst[0] * f.t1 + s.worst[1] * f.t2 + s.worst[2] * f.n));
              }
            });
          }
          return nb::make_tuple(array(std::move(rbf), {n, (size_t)kTerms, 4}), array(std::move(terms), {n}), array(std::move(error), {n}), array(std::move(worst), {n, 3}));
        },
        "tree"_a, "points"_a, "normals"_a, "rules"_a, "n_neighbors"_a, "n_own"_a, "tolerance"_a, "n_threads"_a);

  m.def("evaluate_field",
        [](const RuleView& rules, Terms rbf, Ints terms, Points x, int64_t k, int threads) {
          const size_t n = x.shape(0);
          std::vector<double> value(n);
          {
            nb::gil_scoped_release release;
            const TermView local{rbf.data(), terms.data(), (int64_t)rbf.shape(1)};
            parallel_for(n, 256, threads, [&](int64_t lo, int64_t hi) {
              FieldScratch s;
              evaluate_field(rules, local, x.data() + 3 * lo, hi - lo, k, s, &value[lo]);
            });
          }
          return array(std::move(value), {n});
        },
        "rules"_a, "rbf"_a, "terms"_a, "x"_a, "k"_a, "n_threads"_a);

  m.def("consequent_errors",
        [](const RuleView& rules, Points x, int64_t k, int threads) {
          const size_t n = x.shape(0), count = rules.rules.size();
          std::vector<double> error(count, 0.0), share(count, 0.0);
          {
            nb::gil_scoped_release release;
            const Places places(rules, x.data(), nullptr, n, k, threads);
            std::vector<std::vector<RuleError>> parts((n + kErrorChunk - 1) / kErrorChunk);
            parallel_for(n, kErrorChunk, threads, [&](int64_t lo, int64_t hi) {
              InferenceScratch s;
              infer_runs(rules, places.x(lo), nullptr, hi - lo, k, s, [&](int64_t) { run_errors(s, parts[lo / kErrorChunk]); });
            });
            for (const auto& part : parts)  // in the order of the places: the same sum for any number of threads
              for (const RuleError& e : part) error[e.index] += e.error, share[e.index] += e.share;
          }
          return nb::make_tuple(array(std::move(error), {count}), array(std::move(share), {count}));
        },
        "rules"_a, "x"_a, "k"_a, "n_threads"_a);

  m.def("typical_data",
        [](Points p, Ints offsets, Ints clusters, int iterations, double tolerance, int threads) {
          const size_t cells = offsets.shape(0) - 1;
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
