#include "raysfm/robust/fair_start.h"

#include <algorithm>
#include <iterator>
#include <numeric>
#include <utility>
#include <vector>

namespace raysfm {
namespace {

// Of the matches; where more agree there is no room for another motion.
constexpr double kMostAgree = 0.85;
// Points that speak for the image: so many of each of its parts that there are about as many.
constexpr int kSpeaking = 100;
// A motion that explains a smaller part of what the other does is none of the rig's.
constexpr double kMuchLess = 0.75;
// Of the image: what the rig's motion explains at least. Of three motions of equal size it cannot be told
// which one is the rig's.
constexpr double kLeastShare = 0.5;

// Of some of the points, with all their rays; numbered as those of all.
GenericStart start_of(const RigMatches& all, std::span<const int> points,
                      const GenericStartOptions& options) {
  std::vector<int> number(all.point_count, -1);
  for (size_t i = 0; i < points.size(); ++i) number[points[i]] = static_cast<int>(i);
  std::vector<ObservedRay> rays;
  std::vector<int> of_point, views, cameras;
  for (size_t k = 0; k < all.rays.size(); ++k) {
    if (number[all.points[k]] < 0) continue;
    rays.push_back(all.rays[k]);
    of_point.push_back(number[all.points[k]]);
    views.push_back(all.views[k]);
    if (!all.cameras.empty()) cameras.push_back(all.cameras[k]);
  }
  GenericStart start =
      start_generic({static_cast<int>(points.size()), rays, of_point, views, cameras}, options);
  std::vector<uint8_t> inlier(all.point_count, 0);
  std::vector<Eigen::Vector3d> points_in_rig0(all.point_count, Eigen::Vector3d::Zero());
  for (size_t i = 0; i < start.inlier.size(); ++i) {
    inlier[points[i]] = start.inlier[i];
    if (start.inlier[i] != 0) points_in_rig0[points[i]] = start.points_in_rig0[i];
  }
  start.inlier.swap(inlier);
  start.points_in_rig0.swap(points_in_rig0);
  return start;
}

// As many of each place, and of those with fewer all: the fewest that are enough.
std::vector<int> spread_evenly(std::span<const int> places) {
  std::vector<std::pair<int, int>> by_place;  // (place, point)
  for (size_t i = 0; i < places.size(); ++i) by_place.emplace_back(places[i], static_cast<int>(i));
  std::ranges::sort(by_place);
  std::vector<int> chosen;
  for (size_t each = 1; chosen.size() < kSpeaking && chosen.size() < places.size(); ++each) {
    chosen.clear();
    for (size_t begin = 0, end = 0; begin < by_place.size(); begin = end) {
      while (end < by_place.size() && by_place[end].first == by_place[begin].first) ++end;
      const size_t there = end - begin, taken = std::min(each, there);
      for (size_t k = 0; k < taken; ++k) chosen.push_back(by_place[begin + k * there / taken].second);
    }
  }
  return chosen;
}

bool agrees(const GenericStart& start, int point) {
  return point < static_cast<int>(start.inlier.size()) && start.inlier[point] != 0;
}

std::vector<int> unexplained(std::span<const int> points, const GenericStart& by) {
  std::vector<int> rest;
  std::ranges::copy_if(points, std::back_inserter(rest), [&](int p) { return !agrees(by, p); });
  return rest;
}

// Points that move as one, by a turn alone too.
int moving_as_one(const GenericStart& start) {
  return start.problem == StartProblem::kRotationOnly ? std::max(start.inlier_count, start.rotation_inliers)
                                                      : start.inlier_count;
}

// Whether there may be another motion that is the rig's. Where it is known that the rig turns or stands, none
// is looked for.
bool is_in_doubt(const GenericStart& start, int matches) {
  const bool has_motion = start.ok() || start.problem == StartProblem::kTooFewInliers ||
                          start.problem == StartProblem::kAmbiguous;
  return has_motion && start.inlier_count <= kMostAgree * matches;
}

}  // namespace

FairStart start_fairly(const RigMatches& matches, std::span<const int> places,
                       const GenericStartOptions& options) {
  FairStart fair{start_generic(matches, options)};
  GenericStart& first = fair.start;
  if (!is_in_doubt(first, matches.point_count)) return fair;

  std::vector<int> all(matches.point_count);
  std::iota(all.begin(), all.end(), 0);
  const std::vector<int> speaking = spread_evenly(places);
  const std::vector<int> others = unexplained(speaking, first);
  const auto count = static_cast<double>(speaking.size());
  const double share = 1 - static_cast<double>(others.size()) / count;
  fair.rival_share = moving_as_one(start_of(matches, others, options)) / count;

  const bool is_the_rigs = fair.rival_share <= kMuchLess * share;
  if (is_the_rigs && (first.ok() || share < kLeastShare)) return fair;
  const bool rivals =
      !is_the_rigs && share <= kMuchLess * fair.rival_share && fair.rival_share >= kLeastShare;
  if (is_the_rigs) {
    const GenericStart rival = start_of(matches, unexplained(all, first), options);
    first = start_of(matches, unexplained(all, rival), options);
  } else if (rivals) {
    first = start_of(matches, unexplained(all, first), options);
  } else {
    first.problem = StartProblem::kTwoMotions;
  }
  return fair;
}

}  // namespace raysfm
