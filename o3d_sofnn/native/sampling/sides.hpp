// SPDX-License-Identifier: MIT
// Cells of points divided by the side that these face.
#pragma once
#include <algorithm>
#include <vector>

#include "geometry/linalg.hpp"
#include "geometry/parallel.hpp"

namespace sofnn {

// For each cell first[i] to first[i + 1] the rows of its two parts, one behind the other in `order`, and how many the
// first part has: its normals have a positive product with the main axis of them all, turned to the first one.
inline void divide_cells(const double* normals, const int64_t* first, int64_t cells, int threads, int64_t* order,
                         int64_t* size) {
  parallel_for(cells, 64, threads, [&](int64_t begin, int64_t end) {
    for (int64_t cell = begin; cell < end; ++cell) {
      double m[6] = {0, 0, 0, 0, 0, 0}, value[3];
      for (int64_t i = first[cell]; i < first[cell + 1]; ++i) {
        const Vec3 n = load(normals + 3 * i);
        m[0] += n.x * n.x, m[1] += n.x * n.y, m[2] += n.x * n.z;
        m[3] += n.y * n.y, m[4] += n.y * n.z, m[5] += n.z * n.z;
      }
      Vec3 axes[3];
      eigen_symmetric3(m, value, axes);
      Vec3 axis = axes[2];
      if (dot(axis, load(normals + 3 * first[cell])) < 0) axis = -1.0 * axis;
      int64_t* place = order + first[cell];
      for (int side = 0; side < 2; ++side) {
        for (int64_t i = first[cell]; i < first[cell + 1]; ++i)
          if ((dot(axis, load(normals + 3 * i)) < 0) == (side == 1)) *place++ = i;
        if (side == 0) size[cell] = place - order - first[cell];
      }
    }
  });
}

}  // namespace sofnn
