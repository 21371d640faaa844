// SPDX-License-Identifier: MIT
// Normals by product inference over the nearest rules, eq. (7) and (9), for runs of places that lie close together: one
// search finds the rules for all of them, and each rule is evaluated at all of them at once, a place a lane.
#pragma once
#include "rules/runs.hpp"

namespace sofnn {

// What one rule says at the places of a run. The weight is a logarithm at first, kOut where the rule takes no part.
struct RunRule {
  int64_t index;
  Lanes weight, height, nx, ny, nz;
};
constexpr double kOut = -1e300;
constexpr double kLeastQuality = -27.631021115928547;  // log(1e-12)

struct InferenceScratch {
  Run run;
  Candidates near;
  std::vector<Lanes> sq, nearest;
  std::vector<RunRule> rules;
  int64_t used = 0;
  Lanes best, weight_sum;
};

SOFNN_EXACT SOFNN_CLONES inline void run_distances(const Run& run, const Candidates& near, Lanes* SOFNN_RESTRICT sq) {
  SOFNN_EXACT_BODY
  for (int64_t i = 0; i < near.size; ++i) {
    const double cx = near.x[i], cy = near.y[i], cz = near.z[i];
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) {
      const double dx = cx - run.x[l], dy = cy - run.y[l], dz = cz - run.z[l];
      sq[i][l] = dx * dx + dy * dy + dz * dz;
    }
  }
}

// The k-th smallest of m values in every lane, by insertion into a sorted list of k.
SOFNN_CLONES inline void find_limits(const Lanes* SOFNN_RESTRICT sq, int64_t m, int64_t k,
                                     Lanes* SOFNN_RESTRICT nearest, Lanes* SOFNN_RESTRICT limit) {
  for (int64_t j = 0; j < k; ++j) nearest[j].fill(1e300);
  for (int64_t i = 0; i < m; ++i) {
    double value[kLanes];
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) value[l] = sq[i][l];
    for (int64_t j = 0; j < k; ++j) {
      double* SOFNN_RESTRICT list = nearest[j].data();
      SOFNN_LANES
      for (int l = 0; l < kLanes; ++l) {
        const double a = list[l], b = value[l], low = a < b ? a : b, high = a > b ? a : b;
        list[l] = low, value[l] = high;
      }
    }
  }
  if (k > 0)
    *limit = nearest[k - 1];
  else
    limit->fill(kOut);
}

// Logarithm of the trust in one rule at the places of a run, eq. (7) and (9): the off-line rules with linear consequents.
SOFNN_CLONES inline void weigh_trust(const Rule& rule, const Neuron* neurons, int m, const double* SOFNN_RESTRICT root,
                                     const double* SOFNN_RESTRICT lean, const double* SOFNN_RESTRICT reach,
                                     double* SOFNN_RESTRICT trust) {
  Lanes firing[kNeurons], said[kNeurons], largest, total, sum;
  largest.fill(kOut), total.fill(0), sum.fill(0);
  for (int j = 0; j < m; ++j) {
    const Neuron& n = neurons[j];
    const double first = rule.gates[j].firing, consequent = rule.gates[j].consequent;
    const double c0 = n.center[0], c1 = n.center[1], c2 = n.center[2];
    const double w0 = n.inverse_width[0], w1 = n.inverse_width[1], w2 = n.inverse_width[2];
    const double s0 = n.slope[0], s1 = n.slope[1], s2 = n.slope[2];
    double *SOFNN_RESTRICT fired = firing[j].data(), *SOFNN_RESTRICT say = said[j].data(),
           *SOFNN_RESTRICT most = largest.data();
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) {
      const double a = root[l] - c0, b = lean[l] - c1, c = reach[l] - c2;
      const double u = w0 * a, v = w1 * b, w = w2 * c, f = first - 0.5 * (u * u + v * v + w * w);
      fired[l] = f, say[l] = consequent + s0 * a + s1 * b + s2 * c;
      most[l] = f > most[l] ? f : most[l];
    }
  }
  for (int j = 0; j < m; ++j) {
    const double *SOFNN_RESTRICT fired = firing[j].data(), *SOFNN_RESTRICT say = said[j].data();
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) {
      const double basis = exp_negative(fired[l] - largest[l]);
      total[l] += basis, sum[l] += basis * say[l];
    }
  }
  SOFNN_LANES
  for (int l = 0; l < kLanes; ++l) trust[l] = sum[l] / total[l];
}

// Memberships of the places of a run in one rule: a Gaussian in the tangent plane (half the radius wide), a Gaussian in
// the residual to its quadric, a bell in the angle to the side (von Mises and Fisher), its quality, and, where there are
// off-line rules, its trust.
SOFNN_CLONES inline void evaluate_rule(const Run& run, const RuleView& view, const Rule& rule, const double* SOFNN_RESTRICT sq,
                                       RunRule* SOFNN_RESTRICT out, double* SOFNN_RESTRICT best) {
  const double inv = 1 / rule.radius, radius = rule.radius, inv_tolerance = 1 / rule.tolerance;
  const double narrow = rule.stretch, wide = 1 / rule.stretch;
  const Vec3 c = rule.center, a = inv * rule.frame.t1, b = inv * rule.frame.t2, n = inv * rule.frame.n;
  const Vec3 t1 = rule.frame.t1, t2 = rule.frame.t2, t3 = rule.frame.n;
  const double q[6] = {rule.coefficients[0], rule.coefficients[1], rule.coefficients[2],
                       rule.coefficients[3], rule.coefficients[4], rule.coefficients[5]};
  const double quality = std::max(rule.log_quality, kLeastQuality), concentration = rule.concentration;
  const double *SOFNN_RESTRICT x = run.x.data(), *SOFNN_RESTRICT y = run.y.data(), *SOFNN_RESTRICT z = run.z.data();
  const double *SOFNN_RESTRICT sx = run.side_x.data(), *SOFNN_RESTRICT sy = run.side_y.data(),
               *SOFNN_RESTRICT sz = run.side_z.data(), *SOFNN_RESTRICT limit = run.sq_limit.data();
  Lanes root, cosine, reach, trust;
  SOFNN_LANES
  for (int l = 0; l < kLanes; ++l) {
    const double dx = x[l] - c.x, dy = y[l] - c.y, dz = z[l] - c.z;
    double u = a.x * dx + a.y * dy + a.z * dz, v = b.x * dx + b.y * dy + b.z * dz;
    const double h = n.x * dx + n.y * dy + n.z * dz;
    const double square = narrow * u * u + wide * v * v;
    const double shrink = inverse_sqrt(square > 1 ? square : 1);  // no extrapolation beyond the data of the quadric
    u *= shrink, v *= shrink;
    double arc, qu, qv;
    consequent(q, u, v, &arc, &qu, &qv);
    const double tilt = inverse_sqrt(1 + qu * qu + qv * qv);
    const double height = (h - arc) * tilt * radius;
    const double nx = tilt * (t3.x - qu * t1.x - qv * t2.x), ny = tilt * (t3.y - qu * t1.y - qv * t2.y),
                 nz = tilt * (t3.z - qu * t1.z - qv * t2.z);
    const double miss = height * inv_tolerance;
    const double lean = nx * sx[l] + ny * sy[l] + nz * sz[l];
    const double weight = quality - 2 * square - 0.5 * miss * miss + concentration * lean;
    out->weight[l] = weight, out->height[l] = height;
    out->nx[l] = nx, out->ny[l] = ny, out->nz[l] = nz;
    const double distance = std::abs(height) * inv, unknown = 1 - (sx[l] * sx[l] + sy[l] * sy[l] + sz[l] * sz[l]);
    root[l] = std::sqrt(std::sqrt(distance < 1 ? distance : 1));
    cosine[l] = lean + unknown;  // an unknown side is no reason for mistrust
    reach[l] = square < 4 ? square : 4;
  }
  trust.fill(0);
  if (view.n_neurons) weigh_trust(rule, view.neurons, view.n_neurons, root.data(), cosine.data(), reach.data(), trust.data());
  SOFNN_LANES
  for (int l = 0; l < kLanes; ++l) {
    const double taken = sq[l] <= limit[l] ? out->weight[l] + trust[l] : kOut;
    out->weight[l] = taken;
    best[l] = taken > best[l] ? taken : best[l];
  }
}

// Turns logarithms into weights relative to the largest one, eq. (9), which is safe far from every rule.
SOFNN_CLONES inline void weigh_rules(RunRule* rules, int64_t m, const double* SOFNN_RESTRICT best,
                                     double* SOFNN_RESTRICT sum) {
  for (int64_t i = 0; i < m; ++i) {
    double* SOFNN_RESTRICT w = rules[i].weight.data();
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) {
      const double power = w[l] - best[l];
      w[l] = exp_negative(power);
      sum[l] += w[l];
    }
  }
}

SOFNN_CLONES inline bool any_within(const double* SOFNN_RESTRICT sq, const double* SOFNN_RESTRICT limit) {
  double hits = 0;
  SOFNN_LANES
  for (int l = 0; l < kLanes; ++l) hits += sq[l] <= limit[l] ? 1.0 : 0.0;
  return hits > 0;
}

// Squared distances of the candidates to the places of a run, and that of the k-th nearest of each place; returns the
// number of candidates.
inline int64_t find_rules(Run& run, const Candidates& near, int64_t k, std::vector<Lanes>& sq, std::vector<Lanes>& nearest) {
  const int64_t m = near.size;
  k = std::min(k, m);
  if (static_cast<int64_t>(sq.size()) < m) sq.resize(m);
  if (static_cast<int64_t>(nearest.size()) < k) nearest.resize(k);
  run_distances(run, near, sq.data());
  find_limits(sq.data(), m, k, nearest.data(), &run.sq_limit);
  return m;
}

// Rules of a run and their weights: s.rules up to s.used, memberships relative to the largest, and their sums.
inline void infer_run(const RuleView& view, int64_t k, InferenceScratch& s) {
  const Candidates& near = s.near;
  const int64_t m = find_rules(s.run, near, k, s.sq, s.nearest);
  if (static_cast<int64_t>(s.rules.size()) < m) s.rules.resize(m);
  s.best.fill(2 * kOut), s.weight_sum.fill(0);
  s.used = 0;
  for (int64_t i = 0; i < m; ++i) {
    if (!any_within(s.sq[i].data(), s.run.sq_limit.data())) continue;
    RunRule& rule = s.rules[s.used++];
    rule.index = near.index[i];
    evaluate_rule(s.run, view, view.rules[rule.index], s.sq[i].data(), &rule, s.best.data());
  }
  weigh_rules(s.rules.data(), s.used, s.best.data(), s.weight_sum.data());
}

// Runs of places with what the rules say of each in s.
template <class Visit>
void infer_runs(const RuleView& view, const double* x, const double* sides, int64_t n, int64_t k, InferenceScratch& s,
                const Visit& visit) {
  for_runs(view.tree, x, sides, n, k, s.run, s.near, [&](int64_t first) { infer_run(view, k, s), visit(first); });
}

// Sum of the normals of the rules by weight, and what the rule with the largest weight says.
SOFNN_CLONES inline void sum_normals(const RunRule* rules, int64_t m, RunRule* SOFNN_RESTRICT sum,
                                     RunRule* SOFNN_RESTRICT first) {
  for (int64_t i = 0; i < m; ++i) {
    const double* SOFNN_RESTRICT w = rules[i].weight.data();
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) {
      const double nx = rules[i].nx[l], ny = rules[i].ny[l], nz = rules[i].nz[l], height = rules[i].height[l];
      sum->nx[l] += w[l] * nx, sum->ny[l] += w[l] * ny, sum->nz[l] += w[l] * nz;
      const bool larger = w[l] > first->weight[l];
      first->weight[l] = larger ? w[l] : first->weight[l], first->height[l] = larger ? height : first->height[l];
      first->nx[l] = larger ? nx : first->nx[l], first->ny[l] = larger ? ny : first->ny[l];
      first->nz[l] = larger ? nz : first->nz[l];
    }
  }
}

// Normals of the places of a run, eq. (7), agreement of the contributing rules, residual of the best rule.
inline void run_normals(const InferenceScratch& s, double* out, double* agreement, double* residual) {
  RunRule sum{}, first{};
  sum_normals(s.rules.data(), s.used, &sum, &first);
  for (int64_t l = 0; l < s.run.size; ++l) {
    Vec3 normal{sum.nx[l], sum.ny[l], sum.nz[l]};
    const double total = s.weight_sum[l];
    if (norm(normal) < 1e-6 * total) normal = total * Vec3{first.nx[l], first.ny[l], first.nz[l]};  // the rules cancel
    store(out + 3 * l, unit(normal));
    agreement[l] = std::min(norm(normal) / std::max(total, 1e-300), 1.0), residual[l] = first.height[l];
  }
}

// Contribution of one run to the derivative of the squared output, eq. (7), with respect to the height of a rule: output
// times fuzzy basis function, eq. (9), and the basis function alone, summed over the places.
struct RuleError {
  int64_t index;
  double error, share;
};
constexpr int64_t kErrorChunk = 1024;

SOFNN_CLONES inline void sum_errors(RunRule* rules, int64_t m, const double* SOFNN_RESTRICT weight_sum, int64_t size,
                                    RuleError* SOFNN_RESTRICT out) {
  double output[kLanes] = {}, used[kLanes];  // lanes beyond the run do not count
  for (int l = 0; l < kLanes; ++l) used[l] = l < size ? 1 / weight_sum[l] : 0;
  for (int64_t i = 0; i < m; ++i) {
    double *SOFNN_RESTRICT basis = rules[i].weight.data(), *SOFNN_RESTRICT height = rules[i].height.data();
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) basis[l] *= used[l], output[l] += basis[l] * height[l];
  }
  for (int64_t i = 0; i < m; ++i) {
    const double* SOFNN_RESTRICT basis = rules[i].weight.data();
    double error = 0, share = 0;
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) error += basis[l] * output[l], share += basis[l];
    out[i] = {rules[i].index, error, share};
  }
}

inline void run_errors(InferenceScratch& s, std::vector<RuleError>& out) {
  const size_t before = out.size();
  out.resize(before + s.used);
  sum_errors(s.rules.data(), s.used, s.weight_sum.data(), s.run.size, out.data() + before);
}

}  // namespace sofnn
