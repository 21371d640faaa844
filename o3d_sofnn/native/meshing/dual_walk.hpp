// SPDX-License-Identifier: MIT
// A balanced octree around points, and a walk over the cubes of its dual along the surface of a function: see grid.py.
#pragma once
#include <cmath>
#include <limits>

#include "geometry/hash.hpp"
#include "geometry/parallel.hpp"

namespace sofnn {

class DualWalk {
 public:
  // Whether the cells of all points, and those that the walk may reach around them, have numbers that fit a key.
  static bool holds(const double* points, int64_t n, const double* origin, double size, int top) {
    const double first = 2.0 * static_cast<double>(int64_t{1} << top);
    const double last = static_cast<double>(int64_t{1} << (kBits - 1)) - first;
    bool all = size > 0;
    for (int64_t i = 0; i < 3 * n; ++i) {
      const double cell = (points[i] - origin[i % 3]) / size;
      all &= cell >= first && cell < last;
    }
    return all;
  }

  DualWalk(const double* points, int64_t n, const double* origin, double size, const int64_t* levels, int top, int threads)
      : refined_(top + 1) {
    std::vector<int64_t> cells(n), cubes(n);
    parallel_for(n, 4096, threads, [&](int64_t first, int64_t last) {
      for (int64_t i = first; i < last; ++i) {
        const auto edge = static_cast<double>(int64_t{1} << levels[i]);
        int64_t cell[3], corner[3];
        for (int d = 0; d < 3; ++d) {
          const double x = (points[3 * i + d] - origin[d]) / size;
          cell[d] = static_cast<int64_t>(x), corner[d] = 2 * static_cast<int64_t>(std::nearbyint(x / edge) * edge);
        }
        cells[i] = pack(cell[0], cell[1], cell[2]), cubes[i] = pack(corner[0], corner[1], corner[2]);
      }
    });
    for (int level = 0; level < top; ++level) refine(cells, levels, level);
    int64_t last = -1;  // consecutive points are often in one cube
    for (const int64_t cube : cubes) {
      if (cube != last) visit(cube);
      last = cube;
    }
    look_around();
  }

  // Takes the signs of the leaves that were wanted last, walks on until others are wanted, and returns these; none when
  // the surface has closed.
  std::vector<int64_t> advance(const bool* inside, int64_t n) {
    inside_.insert(inside_.end(), inside, inside + n);
    while (inside_.size() == leaves_.size() && !fresh_.empty()) {
      cross();
      look_around();
    }
    return {leaves_.begin() + inside_.size(), leaves_.end()};
  }

  size_t n_known() const { return inside_.size(); }
  const std::vector<int64_t>& leaves() const { return leaves_; }
  // Corners of the cubes with a change of sign, 8 each; afterwards the walk has forgotten them.
  std::vector<int32_t> take_crossed() { return std::move(crossed_); }

 private:
  static constexpr int kBits = 21;
  static constexpr int64_t kField = (int64_t{1} << kBits) - 1;
  std::vector<KeyMap> refined_;  // cells of each level that are divided
  KeyMap cubes_, nodes_;
  std::vector<int64_t> leaves_, fresh_;
  std::vector<int32_t> corners_, crossed_;  // leaves, 8 a cube
  std::vector<uint8_t> inside_;

  static int64_t pack(int64_t x, int64_t y, int64_t z) {  // also of steps, which may be negative
    return x + y * (int64_t{1} << kBits) + z * (int64_t{1} << 2 * kBits);
  }

  static int64_t halve(int64_t key, int times) {
    const int64_t field = kField >> times;
    return key >> times & (field | field << kBits | field << 2 * kBits);
  }

  // Leaves that touch differ by one level at most: all around a cell there are cells.
  void refine(const std::vector<int64_t>& cells, const int64_t* levels, int level) {
    KeyMap own, &divided = refined_[level + 1];
    int64_t last = -1;
    for (size_t i = 0; i < cells.size(); ++i) {
      if (levels[i] != level) continue;
      const int64_t cell = halve(cells[i], level + 1);
      if (cell != last) own.insert(cell, 0);
      last = cell;
    }
    for (const int64_t key : own.keys())
      for (int64_t z = -1; z <= 1; ++z)
        for (int64_t y = -1; y <= 1; ++y)
          for (int64_t x = -1; x <= 1; ++x) divided.insert(key + pack(x, y, z), 0);
    for (const int64_t key : refined_[level].keys())
      for (int64_t corner = 0; corner < 8; ++corner)
        divided.insert(halve(key + pack(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1), 1), 0);
  }

  void visit(int64_t cube) {
    const int64_t before = cubes_.size();
    cubes_.insert(cube, 0);
    if (cubes_.size() > before) fresh_.push_back(cube);
  }

  // The leaf that holds the finest cell with a middle.
  int64_t leaf(int64_t middle) const {
    const int64_t cell = halve(middle, 1);
    int64_t found = middle;
    for (int level = 1; level < static_cast<int>(refined_.size()); ++level) {
      const int64_t coarse = halve(cell, level);
      if (refined_[level].find(coarse) >= 0) break;
      const int64_t one = pack(1, 1, 1);
      found = (2 * coarse + one) << level;
    }
    return found;
  }

  // Leaves at the corners of the fresh cubes.
  void look_around() {
    corners_.resize(8 * fresh_.size());
    for (size_t i = 0; i < fresh_.size(); ++i)
      for (int64_t c = 0; c < 8; ++c) {
        const int64_t key = leaf(fresh_[i] + pack(c & 1 ? 1 : -1, c & 2 ? 1 : -1, c & 4 ? 1 : -1));
        const auto next = static_cast<int64_t>(leaves_.size());
        const int64_t index = nodes_.insert(key, next);
        if (index == next) leaves_.push_back(key);
        corners_[8 * i + c] = static_cast<int32_t>(index);
      }
  }

  // Keeps the fresh cubes with a change of sign, and goes to their neighbours across faces with one.
  void cross() {
    std::vector<int64_t> cubes;
    cubes.swap(fresh_);
    for (size_t i = 0; i < cubes.size(); ++i) {
      const int32_t* corner = &corners_[8 * i];
      int code = 0;
      for (int c = 0; c < 8; ++c) code |= inside_[corner[c]] << c;
      if (code == 0 || code == 255) continue;
      crossed_.insert(crossed_.end(), corner, corner + 8);
      for (int axis = 0; axis < 3; ++axis)
        for (int side = 0; side < 2; ++side) go(cubes[i], corner, code, axis, side);
    }
  }

  void go(int64_t cube, const int32_t* corner, int code, int axis, int side) {
    const int u = 1 << (axis + 1) % 3, v = 1 << (axis + 2) % 3, base = side << axis;
    const int ring[4] = {base, base | u, base | u | v, base | v};
    int count = 0, turns = 0;
    // The dual edge ends where the smallest leaf beside it does.
    int64_t end = side ? std::numeric_limits<int64_t>::max() : std::numeric_limits<int64_t>::min();
    for (int k = 0; k < 4; ++k) {
      const int64_t key = leaves_[corner[ring[k]]], half = key & -key & kField, middle = key >> axis * kBits & kField;
      count += code >> ring[k] & 1;
      turns += corner[ring[k]] != corner[ring[(k + 3) % 4]];
      end = side ? std::min(end, middle + half) : std::max(end, middle - half);
    }
    // A face with corners that coincide in pairs has no other side.
    if (count == 0 || count == 4 || turns < 3) return;
    const int64_t step = end - (cube >> axis * kBits & kField);
    visit(cube + step * (int64_t{1} << axis * kBits));
  }
};

}  // namespace sofnn
