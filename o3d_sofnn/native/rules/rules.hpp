// SPDX-License-Identifier: MIT
// The rules of a rule base, and the consequent of one of them.
#pragma once
#include "sampling/local_fit.hpp"

namespace sofnn {

// Neurons of the off-line rules that say how far a rule of this rule base is to be trusted at a place.
constexpr int kNeurons = 8;

// What is common to all rules of the base: centre, inverse width and slope of each neuron along the three inputs that
// belong to the place: fourth root of the residual divided by the radius, cosine to the side, squared distance.
struct Neuron {
  double center[3], inverse_width[3], slope[3];
};

// The share of one rule in a neuron: logarithm of its firing strength and consequent by the inputs that belong to it.
struct Gate {
  double firing, consequent;
};

// Concentration of the membership in the angle between a side and the normal of a rule. It is divided by the width of
// the membership in the residual, relative to clean data: the less the residual tells, the more the side decides.
constexpr double kConcentration = 25, kCleanTolerance = 0.02;

// Smallest radius of a rule relative to the size of the rule base, and smallest tolerance relative to the radius. Below
// it, differences of coordinates are rounding errors; smaller values are raised to it, so that no power overflows.
constexpr double kLeast = 1e-15;

struct Rule {
  Vec3 center;
  Frame frame;
  double coefficients[6], radius, stretch, tolerance, quality, log_quality, concentration;
  Gate gates[kNeurons];
};

// The rules of a rule base, one record each, and a tree over their centres.
struct RuleView {
  KdTree tree;
  std::vector<Rule> rules;
  int n_neurons;
  Neuron neurons[kNeurons];

  // gates: (n, m, 2), neurons: (m, 3, 3), m at most kNeurons.
  RuleView(const double* centers, const double* frames, const double* coefficients, const double* radius,
           const double* stretch, const double* tolerance, const double* quality, const double* gates,
           const double* places, int m, int64_t n, int threads)
      : tree(centers, n, threads), rules(n), n_neurons(m) {
    for (int j = 0; j < m; ++j) {
      const double* p = places + 9 * j;
      std::copy(p, p + 3, neurons[j].center);
      std::copy(p + 3, p + 6, neurons[j].inverse_width);
      std::copy(p + 6, p + 9, neurons[j].slope);
    }
    double size = 0;
    for (int64_t i = 0; i < n; ++i) size = std::max(size, norm(load(centers + 3 * i) - load(centers)));
    const double least = std::max(kLeast * size, 1e-100);
    for (int64_t i = 0; i < n; ++i) {
      const double *f = frames + 9 * i, *q = coefficients + 6 * i;
      Rule& r = rules[i];
      r.center = load(centers + 3 * i);
      r.frame = {load(f), load(f + 3), load(f + 6)};
      std::copy(q, q + 6, r.coefficients);
      r.radius = std::max(radius[i], least), r.stretch = std::max(stretch[i], 1.0);
      r.tolerance = std::max(tolerance[i], kLeast * r.radius), r.quality = quality[i];
      r.log_quality = std::log(std::max(quality[i], 1e-300));
      r.concentration = kConcentration * std::max(r.tolerance / r.radius - kCleanTolerance, 0.0);
      for (int j = 0; j < m; ++j) r.gates[j] = {gates[2 * (m * i + j)], gates[2 * (m * i + j) + 1]};
    }
  }
};

// Height and slopes of the consequent of a rule over its tangent plane.
SOFNN_INLINE void consequent(const double* q, double u, double v, double* height, double* slope_u, double* slope_v) {
  const double sq = u * u + v * v, p = u * (q[3] * u + q[4] * v) + q[5] * v * v;
  const double pu = 2 * q[3] * u + q[4] * v, pv = q[4] * u + 2 * q[5] * v;
  const double bend = 2 * p / (sq > 1e-30 ? sq : 1e-30), steep = bend * bend * sq;
  const double root = std::sqrt(1 - (steep < kSteepest ? steep : kSteepest)), arc = 2 / (1 + root);
  // Derivative of the arc by the steepness, times p; none where the arc has ended.
  const double more = steep < kSteepest ? p / ((1 + root) * (1 + root) * root) : 0.0;
  *height = q[0] + q[1] * u + q[2] * v + p * arc;
  *slope_u = q[1] + arc * pu + more * (4 * bend * pu - 2 * bend * bend * u);
  *slope_v = q[2] + arc * pv + more * (4 * bend * pv - 2 * bend * bend * v);
}

}  // namespace sofnn
