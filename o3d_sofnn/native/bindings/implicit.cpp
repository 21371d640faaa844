// SPDX-License-Identifier: MIT
#include "bindings/arrays.hpp"
#include "implicit/field.hpp"
#include "implicit/units.hpp"

namespace sofnn {

using namespace nb::literals;

using Terms = nb::ndarray<const double, nb::shape<-1, -1, 4>, nb::c_contig, nb::device::cpu>;

void bind_implicit(nb::module_& m) {
  m.def("reconstruct_units",
        [](const KdTree& t, Points p, Points normals, const RuleView& rules, Ints neighbors, Ints own, Doubles tolerance) {
          const size_t n = rules.rules.size();
          expect((int64_t)p.shape(0) == t.size() && normals.shape(0) == p.shape(0), "points, normals: expected those of the tree");
          expect(neighbors.shape(0) == n && own.shape(0) == n && tolerance.shape(0) == n,
                 "n_neighbors, n_own, tolerance: expected one for each rule");
          for (size_t i = 0; i < n; ++i)
            expect(own.data()[i] > 0 && own.data()[i] <= neighbors.data()[i] && neighbors.data()[i] < kMostNeighbors / kBoundCount,
                   "n_own: expected 1 to n_neighbors");
          std::vector<double> rbf(n * kTerms * 4, 0.0), error(n), worst(3 * n);
          std::vector<int64_t> terms(n);
          {
            nb::gil_scoped_release release;
            parallel_for(n, 64, t.threads(), [&](int64_t lo, int64_t hi) {
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
        "tree"_a, "points"_a, "normals"_a, "rules"_a, "n_neighbors"_a, "n_own"_a, "tolerance"_a);

  m.def("evaluate_field",
        [](const RuleView& rules, Terms rbf, Ints terms, Points x, int64_t k) {
          const size_t n = x.shape(0), count = rules.rules.size();
          expect(rbf.shape(0) == count && terms.shape(0) == count && all_below(terms.data(), count, rbf.shape(1) + 1),
                 "terms: expected at most as many as rbf has, for each rule");
          expect(k > 0 && k < kMostNeighbors, kNeighborsWanted);
          std::vector<double> value(n);
          {
            nb::gil_scoped_release release;
            const TermView local{rbf.data(), terms.data(), (int64_t)rbf.shape(1)};
            parallel_for(n, 256, rules.tree.threads(), [&](int64_t lo, int64_t hi) {
              FieldScratch s;
              evaluate_field(rules, local, x.data() + 3 * lo, hi - lo, k, s, &value[lo]);
            });
          }
          return array(std::move(value), {n});
        },
        "rules"_a, "rbf"_a, "terms"_a, "x"_a, "k"_a);
}

}  // namespace sofnn
