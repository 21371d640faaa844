// SPDX-License-Identifier: MIT
// Fuzzy c-means (smoothing weight s = 2) inside one cell: the typical data of its points, eq. (1)-(6).
#pragma once
#include <cmath>
#include <vector>

#include "geometry/linalg.hpp"

namespace sofnn {

// points (n, 3) in Morton order; the c centres start evenly spread along that order.
inline void cluster_cell(const double* points, int64_t n, int64_t c, int iterations, double tolerance,
                         double* centers, std::vector<double>& u) {
  for (int64_t j = 0; j < c; ++j) {
    const int64_t lo = j * n / c, hi = std::max((j + 1) * n / c, lo + 1);
    Vec3 sum{0, 0, 0};
    for (int64_t i = lo; i < hi; ++i) sum = sum + load(points + 3 * i);
    store(centers + 3 * j, (1.0 / static_cast<double>(hi - lo)) * sum);
  }
  if (c == 1) return;
  u.assign(n * c, 0.0);
  std::vector<double> sq(c);
  for (int t = 0; t < iterations; ++t) {
    double change = 0;
    for (int64_t i = 0; i < n; ++i) {
      double sum = 0;
      int64_t hits = 0;
      for (int64_t j = 0; j < c; ++j) {
        const Vec3 d = load(points + 3 * i) - load(centers + 3 * j);
        sq[j] = dot(d, d);
        hits += sq[j] == 0;  // Eq. (3)
        sum += sq[j] > 0 ? 1 / sq[j] : 0;
      }
      for (int64_t j = 0; j < c; ++j) {  // Eq. (5)
        const double value = hits ? (sq[j] == 0 ? 1.0 / static_cast<double>(hits) : 0.0) : 1 / (sq[j] * sum);
        change = std::max(change, std::fabs(value - u[i * c + j]));  // Eq. (6)
        u[i * c + j] = value;
      }
    }
    for (int64_t j = 0; j < c; ++j) {  // Eq. (2)
      Vec3 sum{0, 0, 0};
      double weight = 0;
      for (int64_t i = 0; i < n; ++i) {
        const double w = u[i * c + j] * u[i * c + j];
        sum = sum + w * load(points + 3 * i), weight += w;
      }
      if (weight > 0) store(centers + 3 * j, (1 / weight) * sum);
    }
    if (change < tolerance) break;
  }
}

}  // namespace sofnn
