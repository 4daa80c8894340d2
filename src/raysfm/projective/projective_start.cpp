#include "raysfm/projective/projective_start.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>

#include "raysfm/projective/view_estimator.h"
#include "raysfm/projective/view_pair.h"

namespace raysfm {
namespace {

constexpr int kMinViewInliers = 8;

class Builder {
 public:
  Builder(const PointTracks& tracks, const ProjectiveStartOptions& options)
      : tracks_(tracks), options_(options), observations_(tracks), of_point_(tracks.point_count) {
    for (int k = 0; k < tracks.size(); ++k) of_point_[tracks.point[k]].push_back(k);
    result_.scene.views.assign(tracks.image_count, Matrix34d::Zero());
    result_.scene.points.assign(tracks.point_count, Eigen::Vector4d::Zero());
    result_.image_posed.assign(tracks.image_count, 0);
    result_.point_placed.assign(tracks.point_count, 0);
    result_.inlier.assign(tracks.size(), 0);
  }

  Result<ProjectiveStart> build() {
    auto pair =
        farthest_pair(observations_, options_.max_error, options_.max_samples, options_.seed, options_.rank);
    if (!pair) return pair.error();
    begin(*pair);
    adjust(10);
    tried_.assign(tracks_.image_count, 0);
    int adjusted_at = 2;
    for (int image = next_image(); image >= 0; image = next_image()) {
      if (stopped()) return no_reconstruction("interrupted");
      tried_[image] = 1;
      if (!resect(image)) continue;
      place_points();
      const int posed =
          static_cast<int>(std::count(result_.image_posed.begin(), result_.image_posed.end(), 1));
      if (2 * posed < 3 * adjusted_at && posed > 6) continue;
      adjust(10);
      std::fill(tried_.begin(), tried_.end(), 0);
      adjusted_at = posed;
    }
    place_points();
    adjust(30);
    place_points();
    adjust(30);
    if (stopped()) return no_reconstruction("interrupted");
    return std::move(result_);
  }

 private:
  bool stopped() const { return options_.progress && *options_.progress && !(*options_.progress)({}); }

  void begin(const ViewPair& pair) {
    const Matrix34d second = second_view(pair.fundamental);
    result_.images[0] = pair.images[0], result_.images[1] = pair.images[1];
    result_.pair_inliers = pair.inliers;
    result_.scene.views[pair.images[0]].leftCols<3>().setIdentity();
    result_.scene.views[pair.images[1]] = second;
    result_.image_posed[pair.images[0]] = result_.image_posed[pair.images[1]] = 1;
    const std::array views = {result_.scene.views[pair.images[0]], second};
    for (size_t i = 0; i < pair.matches.points.size(); ++i) {
      if (!pair.inlier[i]) continue;
      std::array pixels = {pair.matches.a[i], pair.matches.b[i]};
      if (!correct_match(pair.fundamental, &pixels[0], &pixels[1])) continue;
      const int point = pair.matches.points[i];
      if (triangulate_projective(views, pixels, &result_.scene.points[point]))
        result_.point_placed[point] = 1;
    }
    find_inliers();
  }

  // The image that sees most placed points and was not tried since the last adjustment, -1 without one.
  int next_image() const {
    int best = -1, most = kMinViewInliers - 1;
    for (int j = 0; j < tracks_.image_count; ++j) {
      if (result_.image_posed[j] || tried_[j]) continue;
      const int placed =
          static_cast<int>(std::count_if(observations_.begin(j), observations_.end(j),
                                         [&](int k) { return result_.point_placed[tracks_.point[k]]; }));
      if (placed > most) best = j, most = placed;
    }
    return best;
  }

  bool resect(int image) {
    std::vector<Eigen::Vector4d> points;
    std::vector<Eigen::Vector2d> pixels;
    for (const int* k = observations_.begin(image); k != observations_.end(image); ++k) {
      if (!result_.point_placed[tracks_.point[*k]]) continue;
      points.push_back(result_.scene.points[tracks_.point[*k]]);
      pixels.push_back(tracks_.pixel[*k]);
    }
    ViewEstimator estimator(points, pixels, false, options_.max_error);
    const RansacOptions options{.max_iterations = options_.max_samples,
                                .seed = options_.seed,
                                .stream = 1000 + static_cast<uint64_t>(image)};
    const RansacReport report = ransac(estimator, options, &result_.scene.views[image]);
    const int needed = std::max<int>(kMinViewInliers, static_cast<int>(points.size() / 4));
    if (!report.found() || report.score.inliers < needed) return false;
    result_.image_posed[image] = 1;
    find_inliers();
    return true;
  }

  // Points that were not placed, from the views that see them; from pairs of views when one of them is wrong.
  void place_points() {
    std::vector<Matrix34d> views;
    std::vector<Eigen::Vector2d> pixels;
    for (int i = 0; i < tracks_.point_count; ++i) {
      if (result_.point_placed[i]) continue;
      views.clear(), pixels.clear();
      for (const int k : of_point_[i]) {
        if (!result_.image_posed[tracks_.image[k]]) continue;
        views.push_back(result_.scene.views[tracks_.image[k]]);
        pixels.push_back(tracks_.pixel[k]);
      }
      Eigen::Vector4d point;
      if (views.size() < 3 || !best_point(views, pixels, &point)) continue;
      result_.scene.points[i] = point;
      result_.point_placed[i] = 1;
    }
    find_inliers();
  }

  bool best_point(const std::vector<Matrix34d>& views, const std::vector<Eigen::Vector2d>& pixels,
                  Eigen::Vector4d* best) const {
    const double limit = options_.max_error * options_.max_error;
    const auto agreeing = [&](const Eigen::Vector4d& point) {
      size_t count = 0;
      for (size_t v = 0; v < views.size(); ++v) count += squared_error(views[v], point, pixels[v]) < limit;
      return count;
    };
    if (triangulate_projective(views, pixels, best) && agreeing(*best) == views.size()) return true;
    size_t most = 2;
    for (size_t a = 0; a < views.size(); ++a) {
      const size_t b = (a + (views.size() + 1) / 2) % views.size();
      const std::array two = {views[a], views[b]};
      const std::array at = {pixels[a], pixels[b]};
      Eigen::Vector4d point;
      if (!triangulate_projective(two, at, &point)) continue;
      const size_t count = agreeing(point);
      if (count > most) *best = point, most = count;
    }
    return most > 2 && 2 * most > views.size();
  }

  // Judges every observation of what is posed and placed; a point is given up without two inliers
  // or with more outliers.
  void find_inliers() {
    const double limit = options_.max_error * options_.max_error;
    std::vector<int> good(tracks_.point_count, 0), seen(tracks_.point_count, 0);
    for (int k = 0; k < tracks_.size(); ++k) {
      const int image = tracks_.image[k], point = tracks_.point[k];
      result_.inlier[k] =
          result_.image_posed[image] && result_.point_placed[point] &&
          squared_error(result_.scene.views[image], result_.scene.points[point], tracks_.pixel[k]) < limit;
      good[point] += result_.inlier[k];
      seen[point] += result_.image_posed[image];
    }
    for (int i = 0; i < tracks_.point_count; ++i) {
      if (good[i] < 2 || 2 * good[i] <= seen[i]) result_.point_placed[i] = 0;
    }
    for (int k = 0; k < tracks_.size(); ++k) result_.inlier[k] &= result_.point_placed[tracks_.point[k]];
  }

  void adjust(int iterations) {
    const std::vector<double> weights(result_.inlier.begin(), result_.inlier.end());
    const ObservationIndex index = index_observations(tracks_, weights, nullptr, 6, 2);
    if (index.image_count() < 2) return;
    ProjectiveScene part;
    for (const int j : index.images) part.views.push_back(result_.scene.views[j]);
    for (const int i : index.points) part.points.push_back(result_.scene.points[i]);
    const RobustLoss loss{RobustLoss::Kind::kHuber, 0.5 * options_.max_error};
    adjust_projective(
        index, loss,
        {.max_iterations = iterations, .min_relative_decrease = 1e-4, .progress = options_.progress}, &part);
    for (int j = 0; j < index.image_count(); ++j) result_.scene.views[index.images[j]] = part.views[j];
    for (int i = 0; i < index.point_count(); ++i) result_.scene.points[index.points[i]] = part.points[i];
    find_inliers();
  }

  const PointTracks& tracks_;
  const ProjectiveStartOptions& options_;
  const ImageObservations observations_;
  std::vector<std::vector<int>> of_point_;
  std::vector<uint8_t> tried_;
  ProjectiveStart result_;
};

}  // namespace

Result<ProjectiveStart> projective_start(const PointTracks& tracks, const ProjectiveStartOptions& options) {
  return Builder(tracks, options).build();
}

}  // namespace raysfm
