// SPDX-License-Identifier: MIT
// Points along the Morton curve: interleaved bits of the quantised coordinates, sorted by digits.
#pragma once
#include <algorithm>

#include "geometry/linalg.hpp"
#include "geometry/parallel.hpp"

namespace sofnn {

constexpr int kMortonBits = 21;  // an axis, so that three fit a 64-bit key

struct MortonEntry {
  uint64_t key;
  int64_t index;
};

inline uint64_t spread_bits(uint64_t bits) {  // two zeros after each bit
  bits = (bits | bits << 32) & 0x1F00000000FFFF;
  bits = (bits | bits << 16) & 0x1F0000FF0000FF;
  bits = (bits | bits << 8) & 0x100F00F00F00F00F;
  bits = (bits | bits << 4) & 0x10C30C30C30C30C3;
  return (bits | bits << 2) & 0x1249249249249249;
}

// Keys of n points in ascending order, with the rows they come from; of equal keys the smaller row first.
inline std::vector<MortonEntry> sort_morton(const double* p, int64_t n, int threads) {
  std::vector<MortonEntry> entries(n), other(n);
  double low[3] = {0, 0, 0}, high[3] = {0, 0, 0};
  for (int64_t i = 0; i < n; ++i)
    for (int d = 0; d < 3; ++d) {
      low[d] = i == 0 ? p[d] : std::min(low[d], p[3 * i + d]);
      high[d] = i == 0 ? p[d] : std::max(high[d], p[3 * i + d]);
    }
  const double extent = std::max({high[0] - low[0], high[1] - low[1], high[2] - low[2]});
  constexpr double kMost = (1 << kMortonBits) - 1;
  const double scale = extent > 0 ? kMost / extent : 0;
  parallel_for(n, 4096, threads, [&](int64_t lo, int64_t hi) {
    for (int64_t i = lo; i < hi; ++i) {
      uint64_t key = 0;
      for (int d = 0; d < 3; ++d) {
        const double place = (p[3 * i + d] - low[d]) * scale;
        key |= spread_bits(place < kMost ? static_cast<uint64_t>(place) : static_cast<uint64_t>(kMost)) << d;
      }
      entries[i] = {key, i};
    }
  });
  const auto earlier = [](const MortonEntry& a, const MortonEntry& b) { return a.key < b.key; };
  if (std::is_sorted(entries.begin(), entries.end(), earlier)) return entries;
  constexpr int kDigit = 11;
  for (int shift = 0; shift < 3 * kMortonBits; shift += kDigit) {
    std::vector<int64_t> start((1 << kDigit) + 1, 0);
    const auto digit = [&](const MortonEntry& e) { return (e.key >> shift) & ((1 << kDigit) - 1); };
    for (const MortonEntry& e : entries) ++start[digit(e) + 1];
    for (int i = 0; i < 1 << kDigit; ++i) start[i + 1] += start[i];
    for (const MortonEntry& e : entries) other[start[digit(e)]++] = e;
    entries.swap(other);
  }
  return entries;
}

}  // namespace sofnn
