// SPDX-License-Identifier: MIT
// Arrays that the kernels take and give.
#pragma once
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <vector>

namespace nb = nanobind;

namespace sofnn {

using Points = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Doubles = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Ints = nb::ndarray<const int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Triangles = nb::ndarray<const int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

template <class T>
auto array(std::vector<T>&& data, std::initializer_list<size_t> shape) {
  auto* owned = new std::vector<T>(std::move(data));
  nb::capsule owner(owned, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return nb::ndarray<nb::numpy, T>(owned->data(), shape, owner);
}

// What is no memory error and no crash: lengths and indices that do not fit.
inline void expect(bool fits, const char* message) {
  if (!fits) throw nb::value_error(message);
}

constexpr int64_t kMostNeighbors = int64_t{1} << 31;
constexpr const char* kNeighborsWanted = "k: expected 1 to 2**31 - 1 neighbours";

// Whether all of some indices are from 0 to end - 1.
template <class Index>
bool all_below(const Index* index, size_t count, int64_t end) {
  bool below = true;
  for (size_t i = 0; i < count; ++i) below &= index[i] >= 0 && index[i] < end;
  return below;
}

// Whether numbers ascend from at least `first` to at most `last`, each by at least one step.
inline bool ascending(const Ints& numbers, int64_t first, int64_t last, int64_t step) {
  bool fits = numbers.shape(0) > 0;
  int64_t least = first;
  for (size_t i = 0; i < numbers.shape(0); ++i) {
    fits &= numbers.data()[i] >= least && numbers.data()[i] <= last;
    least = numbers.data()[i] + step;
  }
  return fits;
}

void bind_geometry(nb::module_& m);
void bind_sampling(nb::module_& m);
void bind_rules(nb::module_& m);
void bind_orientation(nb::module_& m);
void bind_implicit(nb::module_& m);
void bind_meshing(nb::module_& m);

}  // namespace sofnn
