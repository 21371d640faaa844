// SPDX-License-Identifier: MIT
// Reconstruct a local progressive surface (Algorithm 2, RLPS): compactly supported RBFs on top of a rule's quadric.
#pragma once
#include "sampling/local_fit.hpp"

namespace sofnn {

constexpr int kMaxCenters = 12;  // delta of Algorithm 2
constexpr int kTerms = kMaxCenters + 1;  // and the offset point of a unit
constexpr double kKernelSupport = 1.0;  // over the radius of the unit

// Wendland's function C2, positive definite in three dimensions; t2 = squared distance over squared support.
inline double wendland(double t2) {
  if (t2 >= 1) return 0;
  const double t = std::sqrt(t2), s = (1 - t) * (1 - t);
  return s * s * (4 * t + 1);
}

struct LocalSurface {
  double term[kTerms][4];  // centre in the frame of the rule, over its radius, and weight
  int terms = 0, centers_used = 0;
  double error = 0;  // largest remaining residual, over the radius
  double worst[3] = {0, 0, 0};
};

inline double quadric_height(const double* q, double u, double v) {
  const double p = q[3] * u * u + q[4] * u * v + q[5] * v * v;
  return q[0] + q[1] * u + q[2] * v + p * arc_over_parabola(p, u * u + v * v);
}

// Sum of the terms (centre, weight) at a place in the frame of the rule.
inline double rbf_terms(const double* terms, int64_t n, double u, double v, double h) {
  double sum = 0;
  for (int64_t i = 0; i < n; ++i, terms += 4) {
    const double a = u - terms[0], b = v - terms[1], c = h - terms[2];
    sum += terms[3] * wendland((a * a + b * b + c * c) / (kKernelSupport * kKernelSupport));
  }
  return sum;
}

// A point of a unit, in the frame of its rule and divided by its radius.
struct UnitPoint {
  double u, v, h;
  int bound;  // 0: on the surface. 1 or -1: on another face, so that the surface may not pass below or above it
  bool own;   // decides whether the unit is refined
  bool center = false;
  double rest = 0;  // residual to the quadric

  double violation(double residual) const {
    return center ? 0 : bound == 0 ? std::fabs(residual) : std::max(bound * residual, 0.0);
  }
};

// tolerance: epsilon of Algorithm 2, over the radius.
inline LocalSurface reconstruct_unit(std::vector<UnitPoint>& points, const double* quadric, double tolerance) {
  LocalSurface f;
  // The offset point: above the middle the quadric's distance is left as it is.
  double target[kTerms] = {0};
  f.term[0][0] = f.term[0][1] = f.term[0][3] = 0;
  f.term[0][2] = quadric[0] + 0.5;
  f.terms = 1;
  for (UnitPoint& p : points) p.rest = p.h - quadric_height(quadric, p.u, p.v);
  while (true) {
    UnitPoint* next = nullptr;
    double largest = 0;
    f.error = 0;
    for (UnitPoint& p : points) {
      const double off = p.violation(p.rest - rbf_terms(f.term[0], f.terms, p.u, p.v, p.h));
      if (off > largest && (p.own || f.centers_used > 0)) largest = off, next = &p;
      if (off > f.error && p.own && p.bound == 0) f.error = off, f.worst[0] = p.u, f.worst[1] = p.v, f.worst[2] = p.h;
    }
    if (largest <= tolerance || f.centers_used == kMaxCenters) break;
    // The field f = h - quadric - sum has to vanish at the centre.
    const double place[3] = {next->u, next->v, next->h};
    std::copy(place, place + 3, f.term[f.terms]);
    target[f.terms] = next->rest;
    next->center = true;
    ++f.terms, ++f.centers_used;
    double a[kTerms * kTerms], b[kTerms];
    for (int i = 0; i < f.terms; ++i) {
      b[i] = target[i];
      for (int j = 0; j <= i; ++j) {
        const double x = f.term[i][0] - f.term[j][0], y = f.term[i][1] - f.term[j][1],
                     z = f.term[i][2] - f.term[j][2];
        a[i * kTerms + j] = wendland((x * x + y * y + z * z) / (kKernelSupport * kKernelSupport)) + (i == j ? 1e-6 : 0);
      }
    }
    if (!cholesky(a, f.terms, kTerms)) {  // a centre on top of another one: this one adds nothing
      --f.terms, --f.centers_used;
      break;
    }
    cholesky_solve(a, f.terms, kTerms, b);
    for (int i = 0; i < f.terms; ++i) f.term[i][3] = b[i];
  }
  if (f.centers_used == 0) f.terms = 0;
  return f;
}

}  // namespace sofnn
