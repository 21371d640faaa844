// SPDX-License-Identifier: MIT
// Loops that the compiler turns into vector instructions, for the widest unit of the machine they run on.
#pragma once
#include <cstdint>
#include <cstring>

// One copy of a function for each generation of vector units, chosen when the module is loaded. Elsewhere
// (other compilers, processors, C libraries, sanitizers) the one copy uses what the platform guarantees.
#if defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && __GNUC__ >= 12 && !defined(__clang__) && \
    !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
#define SOFNN_CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define SOFNN_CLONES
#endif

// Before a loop over the lanes of a run: kept as a loop, it becomes vector instructions; unrolled, it does not.
#if defined(__GNUC__) && !defined(__clang__)
#define SOFNN_LANES _Pragma("GCC unroll 1")
#else
#define SOFNN_LANES
#endif

#if defined(_MSC_VER)
#define SOFNN_INLINE __forceinline
#define SOFNN_RESTRICT __restrict
#else
#define SOFNN_INLINE inline __attribute__((always_inline))
#define SOFNN_RESTRICT __restrict__
#endif

// Equal differences must give equal distances wherever they are computed: no fused or reordered sums.
#if defined(__GNUC__) && !defined(__clang__)
#define SOFNN_EXACT __attribute__((optimize("no-associative-math", "fp-contract=off")))
#define SOFNN_EXACT_BODY
#elif defined(__clang__)
#define SOFNN_EXACT
#define SOFNN_EXACT_BODY _Pragma("clang fp contract(off) reassociate(off)")
#else
#define SOFNN_EXACT
#define SOFNN_EXACT_BODY
#endif

namespace sofnn {

// Squared distances of n places to one.
SOFNN_EXACT SOFNN_CLONES inline void squared_distances(const double* SOFNN_RESTRICT x, const double* SOFNN_RESTRICT y,
                                                       const double* SOFNN_RESTRICT z, int64_t n, double px, double py,
                                                       double pz, double* SOFNN_RESTRICT out) {
  SOFNN_EXACT_BODY
  for (int64_t i = 0; i < n; ++i) {
    const double dx = x[i] - px, dy = y[i] - py, dz = z[i] - pz;
    out[i] = dx * dx + dy * dy + dz * dz;
  }
}

// exp(x) for x <= 0 to 13 digits, without branches and calls: 2^n times a polynomial on [-ln(2) / 2, ln(2) / 2]. What
// is above 0 counts as 0, what is below -700 or no number as that.
SOFNN_INLINE double exp_negative(double x) {
  x = x > -700.0 ? x : -700.0;
  x = x < 0.0 ? x : 0.0;
  const int32_t n = static_cast<int32_t>(x * 1.4426950408889634 - 0.5);
  const double r = x - n * 0.6931471805599453;
  double p = 1.0 / 3628800;
  p = p * r + 1.0 / 362880, p = p * r + 1.0 / 40320, p = p * r + 1.0 / 5040, p = p * r + 1.0 / 720;
  p = p * r + 1.0 / 120, p = p * r + 1.0 / 24, p = p * r + 1.0 / 6, p = p * r + 0.5, p = p * r + 1, p = p * r + 1;
  const uint64_t bits = static_cast<uint64_t>(static_cast<int64_t>(n) + 1023) << 52;
  double power;
  std::memcpy(&power, &bits, sizeof power);
  return p * power;
}

// 1 / sqrt(t) for t >= 1 to all but the last bits, without division: a guess from the exponent and Newton steps, all
// but the last in single precision, which ends at 1e38: so does t.
SOFNN_INLINE double inverse_sqrt(double t) {
  t = t < 1e38 ? t : 1e38;
  const float single = static_cast<float>(t), half = 0.5f * single;
  int32_t bits;
  std::memcpy(&bits, &single, sizeof bits);
  bits = 0x5f3759df - (bits >> 1);
  float y;
  std::memcpy(&y, &bits, sizeof y);
  y *= 1.5f - half * y * y, y *= 1.5f - half * y * y, y *= 1.5f - half * y * y;
  const double root = y;
  return root * (1.5 - 0.5 * t * root * root);
}

}  // namespace sofnn
