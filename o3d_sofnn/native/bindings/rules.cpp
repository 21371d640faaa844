// SPDX-License-Identifier: MIT
#include <nanobind/stl/optional.h>

#include "bindings/arrays.hpp"
#include "rules/inference.hpp"

namespace sofnn {

using namespace nb::literals;

using Frames = nb::ndarray<const double, nb::shape<-1, 3, 3>, nb::c_contig, nb::device::cpu>;
using Coefficients = nb::ndarray<const double, nb::shape<-1, 6>, nb::c_contig, nb::device::cpu>;
using Gates = nb::ndarray<const double, nb::shape<-1, -1, 2>, nb::c_contig, nb::device::cpu>;
using Neurons = nb::ndarray<const double, nb::shape<-1, 3, 3>, nb::c_contig, nb::device::cpu>;

void bind_rules(nb::module_& m) {
  nb::class_<RuleView>(m, "RuleView")
      .def_prop_ro("size", [](const RuleView& v) { return v.rules.size(); })
      .def("__init__",
           [](RuleView* v, Points centers, Frames frames, Coefficients coef, Doubles radius, Doubles stretch, Doubles tolerance, Doubles quality,
              std::optional<Gates> gates, std::optional<Neurons> neurons, int threads) {
             const size_t n = centers.shape(0), m = neurons ? neurons->shape(0) : 0;
             expect(m <= kNeurons && (gates ? gates->shape(1) : 0) == m && (!gates || gates->shape(0) == n),
                    "gates and neurons: expected the same number of neurons, at most 8, or neither");
             expect(frames.shape(0) == n && coef.shape(0) == n && radius.shape(0) == n && stretch.shape(0) == n &&
                        tolerance.shape(0) == n && quality.shape(0) == n,
                    "frames, coefficients, radius, stretch, tolerance, quality: expected one row for each centre");
             new (v) RuleView(centers.data(), frames.data(), coef.data(), radius.data(), stretch.data(), tolerance.data(), quality.data(),
                              gates ? gates->data() : nullptr, neurons ? neurons->data() : nullptr, m, n, threads);
           },
           "centers"_a, "frames"_a, "coefficients"_a, "radius"_a, "stretch"_a, "tolerance"_a, "quality"_a, "gates"_a.none(), "neurons"_a.none(), "n_threads"_a, nb::call_guard<nb::gil_scoped_release>());

  m.def("infer_normals",
        [](const RuleView& rules, Points x, std::optional<Points> sides, int64_t k) {
          const size_t n = x.shape(0);
          expect(!sides || sides->shape(0) == n, "sides: expected one for each row of x");
          expect(k > 0 && k < kMostNeighbors, kNeighborsWanted);
          std::vector<double> normal(3 * n), agreement(n), residual(n);
          {
            nb::gil_scoped_release release;
            const Places places(rules, x.data(), sides ? sides->data() : nullptr, n, k, rules.tree.threads());
            parallel_for(n, 256, rules.tree.threads(), [&](int64_t lo, int64_t hi) {
              InferenceScratch s;
              infer_runs(rules, places.x(lo), places.sides(lo), hi - lo, k, s,
                         [&](int64_t first) { run_normals(s, &normal[3 * (lo + first)], &agreement[lo + first], &residual[lo + first]); });
            });
            normal = places.restore(std::move(normal), 3);
            agreement = places.restore(std::move(agreement), 1), residual = places.restore(std::move(residual), 1);
          }
          return nb::make_tuple(array(std::move(normal), {n, 3}), array(std::move(agreement), {n}), array(std::move(residual), {n}));
        },
        "rules"_a, "x"_a, "sides"_a.none(), "k"_a);

  m.def("consequent_errors",
        [](const RuleView& rules, Points x, int64_t k) {
          const size_t n = x.shape(0), count = rules.rules.size();
          expect(k > 0 && k < kMostNeighbors, kNeighborsWanted);
          std::vector<double> error(count, 0.0), share(count, 0.0);
          {
            nb::gil_scoped_release release;
            const Places places(rules, x.data(), nullptr, n, k, rules.tree.threads());
            std::vector<std::vector<RuleError>> parts((n + kErrorChunk - 1) / kErrorChunk);
            parallel_for(n, kErrorChunk, rules.tree.threads(), [&](int64_t lo, int64_t hi) {
              InferenceScratch s;
              infer_runs(rules, places.x(lo), nullptr, hi - lo, k, s, [&](int64_t) { run_errors(s, parts[lo / kErrorChunk]); });
            });
            for (const auto& part : parts)  // in the order of the places: the same sum for any number of threads
              for (const RuleError& e : part) error[e.index] += e.error, share[e.index] += e.share;
          }
          return nb::make_tuple(array(std::move(error), {count}), array(std::move(share), {count}));
        },
        "rules"_a, "x"_a, "k"_a);
}

}  // namespace sofnn
