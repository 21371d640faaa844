// SPDX-License-Identifier: MIT
// Signed distance at a place: local implicits of the nearest rules blended by fuzzy basis functions, eq. (9).
#pragma once
#include "implicit/rlps.hpp"
#include "rules/inference.hpp"

namespace sofnn {

// Terms of the local surfaces of some rules, (rules, stride, 4): centre and weight, and how many of them there are.
struct TermView {
  const double* rbf = nullptr;
  const int64_t* count = nullptr;
  int64_t stride = 0;

  const double* of(int64_t rule) const { return rbf + 4 * stride * rule; }
};

// What one rule says at the places of a run. Weights are logarithms, kOut where the rule takes no part.
struct FieldRule {
  int64_t index;
  Lanes reach, weight, height, nx, ny, nz;
};

// The rules near one place, for places where faces meet.
struct Faces {
  std::vector<const Rule*> rule;
  std::vector<double> reach, log_weight, height, share;
  std::vector<int> face;
  std::vector<Vec3> foot, normal;
};

struct FieldScratch {
  Run run;
  Candidates near;
  std::vector<Lanes> sq, nearest;
  std::vector<FieldRule> rules;
  std::vector<double> same;
  Faces faces;
};

// Rules whose normals differ by more than this cosine from the leading one belong to another sheet or face. The more
// noise there is in the leading rule, the more its neighbours may differ for no reason but noise.
inline double same_face(double relative_noise) { return std::min(std::max(0.9 - 5 * relative_noise, 0.5), 0.8); }
constexpr int kFaces = 3;

// A face counts when its best rule has at least this membership, relative to the best one (logarithm). What is flat may
// be continued farther: where rules are scarce at an edge the other face would run on beyond it.
constexpr double kFaint = -3, kFaintFlat = -5;
constexpr double kFlat = 0.1;  // sum of the quadratic coefficients up to which a rule is flat

inline double faint(const Rule& rule) {
  const double* q = rule.coefficients;
  return std::fabs(q[3]) + std::fabs(q[4]) + std::fabs(q[5]) < kFlat ? kFaintFlat : kFaint;
}

// Two faces meet in a convex edge when each lies behind the other: their solids intersect; else they unite.
// All pairs of rules vote by their memberships.
inline bool meet_convex(const Faces& s, int a, int b) {
  double vote = 0;
  for (size_t i = 0; i < s.face.size(); ++i)
    for (size_t j = 0; s.face[i] == a && j < s.face.size(); ++j)
      if (s.face[j] == b) {
        const Vec3 d = s.foot[j] - s.foot[i];
        vote += s.share[i] * s.share[j] * (dot(d, s.normal[i]) - dot(d, s.normal[j]));
      }
  return vote < 0;
}

inline double as_solids(double a, double b, bool convex) { return convex ? std::max(a, b) : std::min(a, b); }

// Membership in the tangent plane: its logarithm is so many times the squared distance, 1 at the edge of the ellipse.
// Narrower than in the inference of normals: a quadric drifts away from the surface faster than its normal does.
constexpr double kReach = 4;

// Least width of the membership in the residual, over the radius.
constexpr double kBlur = 0.2;

SOFNN_INLINE double wendland_lane(double t2) {
  const double t = std::sqrt(t2 < 1 ? t2 : 1.0), s = (1 - t) * (1 - t);
  return s * s * (4 * t + 1);
}

// The local implicit of one rule at the places of a run, and its memberships.
SOFNN_CLONES inline void evaluate_implicit(const Run& run, const Rule& rule, const double* SOFNN_RESTRICT terms,
                                           int64_t n_terms, const double* SOFNN_RESTRICT sq,
                                           FieldRule* SOFNN_RESTRICT out) {
  const double inv = 1 / rule.radius, radius = rule.radius, narrow = rule.stretch, wide = 1 / rule.stretch;
  const double inv_tolerance = 1 / std::max(rule.tolerance, kBlur * radius), quality = rule.log_quality;
  const Vec3 c = rule.center, t1 = rule.frame.t1, t2 = rule.frame.t2, t3 = rule.frame.n;
  const double q[6] = {rule.coefficients[0], rule.coefficients[1], rule.coefficients[2],
                       rule.coefficients[3], rule.coefficients[4], rule.coefficients[5]};
  double us[kLanes], vs[kLanes], hs[kLanes], squares[kLanes], more[kLanes];
  SOFNN_LANES
  for (int l = 0; l < kLanes; ++l) {
    const double dx = inv * (run.x[l] - c.x), dy = inv * (run.y[l] - c.y), dz = inv * (run.z[l] - c.z);
    const double u = t1.x * dx + t1.y * dy + t1.z * dz, v = t2.x * dx + t2.y * dy + t2.z * dz;
    const double square = narrow * u * u + wide * v * v;
    const double shrink = inverse_sqrt(square > 1 ? square : 1);  // no extrapolation beyond the data of the quadric
    us[l] = u * shrink, vs[l] = v * shrink, hs[l] = t3.x * dx + t3.y * dy + t3.z * dz;
    squares[l] = square, more[l] = 0;
  }
  for (int64_t i = 0; i < n_terms; ++i) {
    const double x = terms[4 * i], y = terms[4 * i + 1], z = terms[4 * i + 2], w = terms[4 * i + 3];
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) {
      const double a = us[l] - x, b = vs[l] - y, d = hs[l] - z;
      more[l] += w * wendland_lane((a * a + b * b + d * d) / (kKernelSupport * kKernelSupport));
    }
  }
  SOFNN_LANES
  for (int l = 0; l < kLanes; ++l) {
    double arc, qu, qv;
    consequent(q, us[l], vs[l], &arc, &qu, &qv);
    const double tilt = inverse_sqrt(1 + qu * qu + qv * qv);
    const double height = (hs[l] - arc - more[l]) * tilt * radius, miss = height * inv_tolerance;
    const double reach = quality - kReach * squares[l];
    const bool taken = sq[l] <= run.sq_limit[l];
    out->reach[l] = taken ? reach : kOut, out->weight[l] = taken ? reach - 0.5 * miss * miss : kOut;
    out->height[l] = height;
    out->nx[l] = tilt * (t3.x - qu * t1.x - qv * t2.x), out->ny[l] = tilt * (t3.y - qu * t1.y - qv * t2.y);
    out->nz[l] = tilt * (t3.z - qu * t1.z - qv * t2.z);
  }
}

// Blend of the rules on the face of the leading one, eq. (9), at the places of a run; more: whether there are others.
// The leading rule is on its own face, though the frame of a given rule need not be orthonormal.
SOFNN_CLONES inline void blend_first_face(const FieldRule* SOFNN_RESTRICT rules, const double* SOFNN_RESTRICT same,
                                          int64_t m, double* SOFNN_RESTRICT value, double* SOFNN_RESTRICT more) {
  double best[kLanes], height[kLanes], nx[kLanes], ny[kLanes], nz[kLanes], least[kLanes], sum[kLanes], total[kLanes];
  SOFNN_LANES
  for (int l = 0; l < kLanes; ++l) {
    best[l] = 2 * kOut;
    height[l] = nx[l] = ny[l] = nz[l] = least[l] = sum[l] = total[l] = more[l] = 0;
  }
  for (int64_t i = 0; i < m; ++i) {
    const FieldRule& r = rules[i];
    const double limit = same[i];
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) {
      const bool better = r.weight[l] > best[l];
      best[l] = better ? r.weight[l] : best[l], least[l] = better ? limit : least[l];
      height[l] = better ? r.height[l] : height[l];
      nx[l] = better ? r.nx[l] : nx[l], ny[l] = better ? r.ny[l] : ny[l], nz[l] = better ? r.nz[l] : nz[l];
    }
  }
  for (int64_t i = 0; i < m; ++i) {
    const FieldRule& r = rules[i];
    SOFNN_LANES
    for (int l = 0; l < kLanes; ++l) {
      const bool with = r.nx[l] * nx[l] + r.ny[l] * ny[l] + r.nz[l] * nz[l] >= least[l];
      const double power = r.weight[l] - best[l], w = with ? exp_negative(power) : 0.0;
      sum[l] += w * r.height[l], total[l] += w;
      more[l] = !with && r.weight[l] > kOut ? 1.0 : more[l];
    }
  }
  SOFNN_LANES
  for (int l = 0; l < kLanes; ++l) value[l] = total[l] > 0 ? sum[l] / total[l] : height[l];
}

// The rules near a place are gathered into at most three faces by their normals; each face blends its local implicits
// by fuzzy basis functions, eq. (9), and faces combine as solids (Ohtake et al. 2003, sharp features).
inline double combine_faces(Faces& s) {
  const int64_t n = s.rule.size();
  if (n == 0) return 0;
  s.face.assign(n, -1), s.share.resize(n);
  const double nearest = *std::max_element(s.reach.begin(), s.reach.end());
  double height[kFaces] = {};
  int count = 0;
  for (; count < kFaces; ++count) {
    int64_t best = -1;
    for (int64_t i = 0; i < n; ++i)
      if (s.face[i] < 0 && (count == 0 || s.reach[i] > nearest + faint(*s.rule[i])) &&
          (best < 0 || s.log_weight[i] > s.log_weight[best]))
        best = i;
    if (best < 0) break;
    double sum = 0, total = 0, top = -1e300;
    const double same = same_face(s.rule[best]->tolerance / s.rule[best]->radius);
    for (int64_t i = 0; i < n; ++i)
      if (s.face[i] < 0 && (i == best || dot(s.normal[i], s.normal[best]) >= same))
        s.face[i] = count, top = std::max(top, s.log_weight[i]);
    for (int64_t i = 0; i < n; ++i)
      if (s.face[i] == count) {
        const double w = std::exp(s.log_weight[i] - top);
        sum += w * s.height[i], total += w;
      }
    height[count] = sum / total;
  }
  if (count == 1) return height[0];
  for (int64_t i = 0; i < n; ++i) s.share[i] = std::exp(s.reach[i] - nearest);
  const bool convex = meet_convex(s, 0, 1);
  if (count == 2) return as_solids(height[0], height[1], convex);
  // Of three faces the two that meet in an edge of another kind than the other edges come first.
  const bool with_first = meet_convex(s, 0, 2), with_second = meet_convex(s, 1, 2);
  if (with_first == with_second) return as_solids(as_solids(height[0], height[1], convex), height[2], with_first);
  if (convex == with_second) return as_solids(as_solids(height[0], height[2], with_first), height[1], convex);
  return as_solids(as_solids(height[1], height[2], with_second), height[0], convex);
}

// The rules that take part at one place of a run.
inline void take_place(const RuleView& view, const FieldRule* rules, int64_t m, int l, Faces& s) {
  s.rule.clear(), s.reach.clear(), s.log_weight.clear(), s.height.clear(), s.foot.clear(), s.normal.clear();
  for (int64_t i = 0; i < m; ++i) {
    const FieldRule& r = rules[i];
    if (r.weight[l] <= kOut) continue;
    const Rule& rule = view.rules[r.index];
    s.rule.push_back(&rule), s.reach.push_back(r.reach[l]), s.log_weight.push_back(r.weight[l]);
    s.height.push_back(r.height[l]), s.normal.push_back({r.nx[l], r.ny[l], r.nz[l]});
    s.foot.push_back(rule.center + (rule.radius * rule.coefficients[0]) * rule.frame.n);
  }
}

// Signed distance at the places of the run that s holds.
inline void evaluate_run(const RuleView& view, const TermView& terms, int64_t k, FieldScratch& s, double* value) {
  const int64_t m = find_rules(s.run, s.near, k, s.sq, s.nearest);
  if (static_cast<int64_t>(s.rules.size()) < m) s.rules.resize(m), s.same.resize(m);
  int64_t used = 0;
  for (int64_t i = 0; i < m; ++i) {
    if (!any_within(s.sq[i].data(), s.run.sq_limit.data())) continue;
    const int64_t j = s.near.index[i];
    const Rule& rule = view.rules[j];
    s.rules[used].index = j, s.same[used] = same_face(rule.tolerance / rule.radius);
    evaluate_implicit(s.run, rule, terms.of(j), terms.count[j], s.sq[i].data(), &s.rules[used++]);
  }
  double values[kLanes], more[kLanes];
  blend_first_face(s.rules.data(), s.same.data(), used, values, more);
  for (int l = 0; l < s.run.size; ++l) {
    if (more[l] > 0) take_place(view, s.rules.data(), used, l, s.faces), values[l] = combine_faces(s.faces);
    value[l] = values[l];
  }
}

// The same at n places of which consecutive ones lie close together.
inline void evaluate_field(const RuleView& view, const TermView& terms, const double* x, int64_t n, int64_t k,
                           FieldScratch& s, double* value) {
  for_runs(view.tree, x, nullptr, n, k, s.run, s.near, [&](int64_t lo) { evaluate_run(view, terms, k, s, value + lo); });
}

}  // namespace sofnn
