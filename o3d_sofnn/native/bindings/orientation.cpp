// SPDX-License-Identifier: MIT
#include "bindings/arrays.hpp"
#include "orientation/winding.hpp"

namespace sofnn {

using namespace nb::literals;

// One source for each point of the tree.
template <class Sources>
static const double* sources(const WindingTree& t, const Sources& values) {
  expect((int64_t)values.shape(0) == t.size(), "mu, charge: expected one for each point of the tree");
  return values.data();
}

// Sums at places that are asked for once, and at those of kept lists.
static std::vector<WindingSums> evaluate(const WindingTree& t, Sum what, const double* source, Points x, Doubles width,
                                  double theta) {
  expect(width.shape(0) == x.shape(0), "width: expected one for each row of x");
  std::vector<WindingSums> sums(x.shape(0));
  nb::gil_scoped_release release;
  t.evaluate(what, source, x.data(), width.data(), x.shape(0), theta, t.threads(), sums.data());
  return sums;
}

static std::vector<WindingSums> evaluate(const WindingTree& t, Sum what, const double* source, const WindingLists& lists,
                                  Doubles width) {
  expect((int64_t)width.shape(0) == lists.size && lists.tree_size == t.size(), "width, lists: expected those of the tree");
  std::vector<WindingSums> sums(lists.size);
  nb::gil_scoped_release release;
  t.evaluate(what, source, lists, width.data(), t.threads(), sums.data());
  return sums;
}

static auto winding_of(const std::vector<WindingSums>& sums) {
  std::vector<double> values(sums.size());
  std::transform(sums.begin(), sums.end(), values.begin(), [](const WindingSums& s) { return s.winding; });
  return array(std::move(values), {sums.size()});
}

static auto vector_of(const std::vector<WindingSums>& sums) {
  std::vector<double> values(3 * sums.size());
  for (size_t i = 0; i < sums.size(); ++i) std::copy(sums[i].vector, sums[i].vector + 3, &values[3 * i]);
  return array(std::move(values), {sums.size(), (size_t)3});
}

void bind_orientation(nb::module_& m) {
  nb::class_<WindingLists>(m, "WindingLists");

  nb::class_<WindingTree>(m, "WindingTree")
      .def("__init__",
           [](WindingTree* t, Points p, Doubles area, int threads) {
             expect(area.shape(0) == p.shape(0) && p.shape(0) < size_t{1} << 30, "area: expected one for each point, of at most 2**30");
             nb::gil_scoped_release release;
             new (t) WindingTree(p.data(), area.data(), p.shape(0), threads);
           },
           "points"_a, "area"_a, "n_threads"_a = 1)
      .def("order", [](const WindingTree& t) { return array(std::vector<int64_t>(t.order()), {(size_t)t.size()}); })
      .def("lists",
           [](const WindingTree& t, Points x, double theta) {
             nb::gil_scoped_release release;
             return t.lists(x.data(), x.shape(0), theta, t.threads());
           },
           "x"_a, "theta"_a)
      .def("winding",
           [](const WindingTree& t, Points mu, Points x, Doubles width, double theta) {
             return winding_of(evaluate(t, Sum::winding, sources(t, mu), x, width, theta));
           },
           "mu"_a, "x"_a, "width"_a, "theta"_a)
      .def("gradient",
           [](const WindingTree& t, Points mu, Points x, Doubles width, double theta) {
             const std::vector<WindingSums> sums = evaluate(t, Sum::gradient, sources(t, mu), x, width, theta);
             return nb::make_tuple(winding_of(sums), vector_of(sums));
           },
           "mu"_a, "x"_a, "width"_a, "theta"_a)
      .def("winding_at",
           [](const WindingTree& t, Points mu, const WindingLists& lists, Doubles width) {
             return winding_of(evaluate(t, Sum::winding, sources(t, mu), lists, width));
           },
           "mu"_a, "lists"_a, "width"_a)
      .def("gradient_at",
           [](const WindingTree& t, Points mu, const WindingLists& lists, Doubles width) {
             const std::vector<WindingSums> sums = evaluate(t, Sum::gradient, sources(t, mu), lists, width);
             return nb::make_tuple(winding_of(sums), vector_of(sums));
           },
           "mu"_a, "lists"_a, "width"_a)
      .def("adjoint_at",
           [](const WindingTree& t, Doubles charge, const WindingLists& lists, Doubles width) {
             return vector_of(evaluate(t, Sum::adjoint, sources(t, charge), lists, width));
           },
           "charge"_a, "lists"_a, "width"_a);
}

}  // namespace sofnn
