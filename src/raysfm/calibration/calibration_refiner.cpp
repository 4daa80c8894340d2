#include "raysfm/calibration/calibration_refiner.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <string>

#include "raysfm/bundle/bundle_adjuster.h"
#include "raysfm/bundle/residual.h"
#include "raysfm/camera/model_check.h"
#include "raysfm/features/octaves.h"

namespace raysfm {
namespace {

constexpr int kFirst = 20;         // key frames, after which a calibration is asked for
constexpr int kLeastStretch = 4;   // of the last
constexpr double kGrowth = 2;      // of the key frames from one time to the next
constexpr double kRescaled = 0.1;  // logarithm of the factor to a scale that makes it another
// Key frames after which a readout is asked for, and most at the end, where more have told it already if they
// do.
constexpr int kShutterKeyFrames = 8, kMostForShutter = 40;
constexpr int kLeastSeen = 3;  // key frames that see a point
// Points of a key frame, and of one of a stretch of kLongest, which is measured but once: of 10, 20 and 40
// the first leaves kitti00-small a third more drift, and twice as much where its focal length is given 2 %
// off. In short stretches 20 take a rendered pan's lens away.
constexpr int kPoints = 10, kPointsOfLong = 40;
// Where a shutter rolls, whose readout and the lens tell each other: with 20 rendered drives tell their
// readout half as surely; 160 take twice the time and tell little more.
constexpr int kPointsScanned = 80;
constexpr int kFirstHas = 4;  // times as many
// Standard deviations, beyond which an observation says nothing of a calibration: a map that has moved since
// it fitted may have brought its point next to the plane of the camera, where distortions are without
// measure.
constexpr double kMostError = 4;
constexpr double kDoubt = 5;  // of a calibration that is told to be refined
constexpr double kFar = 0.2;  // effect of a change after which residuals are linearised anew
// Logarithm of the ratio of two focal lengths, and standard deviations of it, that a lens has zoomed.
constexpr double kZoom = 0.05, kSurelyZoomed = 5;
// Standard deviations of a readout in a short stretch that speak of one.
constexpr double kSurelyScanned = 4;
// Where a stretch comes to rest itself: how often it moves on, and steps of its adjustment each time.
constexpr int kMostRests = 3, kMostSteps = 2;
constexpr double kRests = 1e-4, kLittleDamping = 1e-8;
const BundleOptions kMeasure{.loss = {RobustLoss::Kind::kHuber, 1.0}};

BundleOptions by_noise(const BundleProblem& problem) {
  BundleOptions options = kMeasure;
  options.loss = loss_for_noise(problem);
  return options;
}

bool can_be(const Rig& rig) {
  return std::ranges::none_of(rig.cameras,
                              [](const Camera& camera) { return find_problem(camera.model).has_value(); });
}

// Of each track the observations in key frames [begin, end) that see its point where it is.
std::vector<int> count_seen(const Map& map, int begin, int end) {
  std::vector<int> seen(map.tracks.size(), 0);
  for (int k = begin; k < end; ++k) {
    const MapKeyFrame& keyframe = map.keyframes[k];
    for (int f = 0; f < keyframe.size(); ++f) {
      if (keyframe.tracks[f] >= 0) seen[keyframe.tracks[f]] += keyframe.inliers[f];
    }
  }
  return seen;
}

}  // namespace

CalibrationRefiner::CalibrationRefiner(const Rig& given, LensRefinement how, const CalibrationPrior& prior)
    : how_(how),
      parameters_(given, how == LensRefinement::kOn ? kDoubt : 1, prior),
      values_(parameters_.first_values()),
      begins_with_shutter_(has_found_shutter()) {
  choice_ = choose(CalibrationEvidence::nothing(values_));
}

CalibrationRefiner::CalibrationRefiner(const RefinedRig& present)
    : CalibrationRefiner(present.given, LensRefinement::kAuto) {
  values_ = present.values;
}

int CalibrationRefiner::measured_until(int world) const {
  int end = 0;
  for (const Stretch& s : stretches_) {
    if (s.world == world) end = std::max(end, s.end);
  }
  return end;
}

// Where the stretch begins that the next key frames of a world belong to.
int CalibrationRefiner::first_open(int world) const {
  int first = 0;
  for (const Stretch& s : stretches_) {
    if (s.world == world) first = std::max(first, s.is_open() ? s.begin : s.end);
  }
  return first;
}

int CalibrationRefiner::measured() const {
  int keyframes = 0;
  for (const Stretch& s : stretches_) keyframes += s.keyframes;
  return keyframes;
}

// Where rays have different origins, what is seen from a map of another scale tells another lens.
bool CalibrationRefiner::is_outdated(const Stretch& stretch, int world, const Map& map) const {
  return stretch.world == world && std::abs(std::log(map.rescaled / stretch.rescaled)) > kRescaled;
}

// To measure and to adapt everything is dear: only what has become much more evidence since is worth it.
bool CalibrationRefiner::is_due(int world, const Map& map, bool last) const {
  if (how_ == LensRefinement::kOff || parameters_.size() == 0) return false;
  const int keyframes = static_cast<int>(map.keyframes.size());
  const auto is_outdated = [&](const Stretch& s) { return this->is_outdated(s, world, map); };
  if (keyframes >= kFirst && std::ranges::any_of(stretches_, is_outdated)) return true;
  const int fresh = keyframes - measured_until(world);
  return fresh >= (last ? kLeastStretch : std::max<int>(kFirst, std::lround((kGrowth - 1) * measured())));
}

// Of each key frame of a stretch of so many.
int CalibrationRefiner::points_of(const TrackingRig& rig, int keyframes) const {
  if (rig.scans()) return kPointsScanned;
  return keyframes < kLongest ? kPoints : kPointsOfLong;
}

// The longest tracks, of each key frame about as many.
void CalibrationRefiner::choose_points(const Map& map, int begin, int end, int usual) {
  point_of_track_.resize(map.tracks.size(), -1);
  tracks_.clear();
  std::vector<std::pair<int, int>> by_length;
  const std::vector<int> seen = count_seen(map, begin, end);
  for (int k = begin; k < end; ++k) {
    by_length.clear();
    for (const int t : map.keyframes[k].tracks) {
      if (t < 0 || seen[t] < kLeastSeen || point_of_track_[t] >= 0 || !map.tracks[t].triangulated) continue;
      by_length.push_back({-seen[t], t});
    }
    const int count = std::min<int>(by_length.size(), k == begin ? kFirstHas * usual : usual);
    std::partial_sort(by_length.begin(), by_length.begin() + count, by_length.end());
    for (int i = 0; i < count; ++i) {
      point_of_track_[by_length[i].second] = static_cast<int>(tracks_.size());
      tracks_.push_back(by_length[i].second);
    }
  }
  for (const int t : tracks_) point_of_track_[t] = -1;
}

void CalibrationRefiner::gather(const TrackingRig& rig, const Map& map, const MotionOf& motion_of, int begin,
                                int end, int points) {
  poses_.clear();
  free_.clear();
  points_.clear();
  observations_.clear();
  rays_.clear();
  sigmas_.clear();
  velocities_.clear();
  const bool has_readout = parameters_.has_readout();
  std::vector<RigMotion> of_keyframe;
  for (int k = begin; k < end; ++k) {
    if (has_readout) of_keyframe.push_back(motion_of(k));
    poses_.push_back(map.keyframes[k].rig_from_world);
    free_.push_back(k > begin);
  }
  choose_points(map, begin, end, points);
  for (const int t : tracks_) {
    for (const TrackObservation& o : map.tracks[t].observations) {
      const MapKeyFrame& k = map.keyframes[o.keyframe];
      if (o.keyframe < begin || o.keyframe >= end || !k.inliers[o.feature]) continue;
      observations_.push_back({o.keyframe - begin, static_cast<int>(points_.size()), k.cameras[o.feature],
                               k.instant_pixel(o.feature).cast<double>()});
      sigmas_.push_back(octave_side(k.octaves[o.feature]));
      if (rig.angular()) rays_.push_back(k.rays[o.feature]);
      if (has_readout) {
        const int camera = k.cameras[o.feature];
        // What would leave the image within a usual readout lies next to the plane of the camera, and would
        // outweigh all else.
        const double fastest = rig.camera(camera).width / parameters_.readout_prior();
        const double seconds = rig.camera(camera).exposed_after(k.pixels[o.feature].cast<double>());
        const Eigen::Vector2d velocity = image_velocity(
            rig, camera, k.rig_from_world * map.tracks[t].position, of_keyframe[o.keyframe - begin], seconds);
        velocities_.push_back(velocity.norm() > fastest ? Eigen::Vector2d::Zero() : velocity);
      }
    }
    points_.push_back(map.tracks[t].position);
  }
  fits_.assign(observations_.size(), 1);
}

CalibrationRefiner::Stretch CalibrationRefiner::measured_stretch(const TrackingRig& rig, int world,
                                                                 const Map& map, const MotionOf& motion_of,
                                                                 int begin, int end, int points,
                                                                 Measure measure) {
  gather(rig, map, motion_of, begin, end, points);
  const BundleProblem problem{.cameras = rig.cameras(),
                              .rig_from_world = poses_,
                              .pose_is_free = free_,
                              .points = points_,
                              .point_is_fixed = {},
                              .observations = observations_,
                              .is_inlier = fits_,
                              .rays = rays_,
                              .lenses = {},
                              .sigmas = sigmas_,
                              .scale_prior = {}};
  update_inliers(problem, kMostError);
  std::optional<CalibrationEvidence> evidence =
      measure == Measure::kAtRest
          ? evidence_at_rest(rig, problem)
          : measure_calibration(problem, measure == Measure::kByNoise ? by_noise(problem) : kMeasure,
                                parameters_, values_, rig.weight(), velocities_);
  if (!evidence) evidence = CalibrationEvidence::nothing(values_);
  return {world, begin, end, end - begin, map.rescaled, *std::move(evidence)};
}

// Wrong matches lose their say on the way to where the others fit.
std::optional<CalibrationEvidence> CalibrationRefiner::evidence_at_rest(const TrackingRig& rig,
                                                                        BundleProblem problem) {
  BundleAdjuster adjuster;
  BundleOptions options{
      .max_iterations = kMostSteps, .min_relative_decrease = kRests, .initial_damping = kLittleDamping};
  std::optional<CalibrationEvidence> evidence;
  std::optional<TrackingRig> moved;
  Eigen::VectorXd values = values_;
  for (int rest = 0; rest < kMostRests; ++rest) {
    options.loss = loss_for_noise(problem);
    adjuster.adjust(problem, options);
    update_inliers(problem, kMostError);
    options.loss = redescending_loss_for_noise(problem);
    adjuster.adjust(problem, options);
    evidence = measure_calibration(problem, options, parameters_, values, rig.weight(), velocities_);
    if (!evidence) break;
    const std::optional<Eigen::VectorXd> next = likelier(parameters_, *evidence, longest_readout());
    if (!next) break;
    Rig there = parameters_.rig(*next);
    if (!can_be(there)) break;
    values = *next;
    moved.emplace(std::move(there), rig.angular() ? ErrorMeasure::kAngular : ErrorMeasure::kPixel);
    problem.cameras = moved->cameras();
    for (size_t i = 0; i < rays_.size(); ++i) {
      const BundleObservation& o = observations_[i];
      if (!moved->observe(o.camera, o.pixel.cast<float>(), &rays_[i])) fits_[i] = 0;
    }
  }
  return evidence;
}

void CalibrationRefiner::measure(const TrackingRig& rig, int world, const Map& map,
                                 std::span<const uint8_t> left_out, const MotionOf& motion_of) {
  std::erase_if(stretches_, [&](const Stretch& s) { return is_outdated(s, world, map); });
  const int first = first_open(world);
  std::erase_if(stretches_, [&](const Stretch& s) { return s.world == world && s.begin >= first; });
  measure_from(first, rig, world, map, left_out, motion_of, Measure::kEven);
}

void CalibrationRefiner::measure_from(int first, const TrackingRig& rig, int world, const Map& map,
                                      std::span<const uint8_t> left_out, const MotionOf& motion_of,
                                      Measure how) {
  const int count = static_cast<int>(map.keyframes.size());
  const auto leaves_out = [&](int k) { return k < std::ssize(left_out) && left_out[k]; };
  for (int begin = first, end; begin < count; begin = std::max(end, begin + 1)) {
    for (end = begin; end < count && end - begin < kLongest && !leaves_out(end);) ++end;
    if (end - begin >= kLeastStretch)
      stretches_.push_back(
          measured_stretch(rig, world, map, motion_of, begin, end, points_of(rig, end - begin), how));
  }
}

void CalibrationRefiner::measure_again(const TrackingRig& rig, int world, const Map& map,
                                       std::span<const uint8_t> left_out, const MotionOf& motion_of,
                                       Measure how) {
  std::erase_if(stretches_, [&](const Stretch& s) { return s.world == world; });
  measure_from(0, rig, world, map, left_out, motion_of, how);
}

void CalibrationRefiner::renumber(int world, int into, std::span<const int> new_number_of_keyframe) {
  for (Stretch& s : stretches_) {
    if (s.world != world) continue;
    s.world = into;
    s.begin = new_number_of_keyframe[s.begin];
    s.end = new_number_of_keyframe[s.end - 1] + 1;
  }
}

CalibrationChoice CalibrationRefiner::choose(const CalibrationEvidence& evidence, bool takes_all) const {
  return choose_calibration(parameters_, evidence, longest_readout(), takes_all);
}

// Few key frames tell of a guess what many do not confirm: what is not surely off waits for all of them.
std::optional<Rig> CalibrationRefiner::better(bool last) {
  CalibrationEvidence all = CalibrationEvidence::nothing(values_);
  for (const Stretch& s : stretches_) all.add(s.evidence);
  choice_ = within_reach(parameters_, values_,
                         choose(all, last && (parameters_.is_guess() || parameters_.is_found())));
  if (begins_with_shutter_ && !has_readout(choice_.values)) return std::nullopt;
  return is_worth_it(choice_, parameters_.is_found() || !values_.isZero()) ? chosen_rig() : std::nullopt;
}

// Of a world's stretches those before and those from `split` on.
std::optional<FocalChange> CalibrationRefiner::change_at(std::span<const Stretch> stretches, size_t split,
                                                         double* significance) const {
  CalibrationEvidence parts[2] = {CalibrationEvidence::nothing(values_),
                                  CalibrationEvidence::nothing(values_)};
  for (size_t s = 0; s < stretches.size(); ++s) parts[s >= split].add(stretches[s].evidence);
  const CalibrationChoice before = choose(parts[0]), after = choose(parts[1]);
  std::optional<FocalChange> change;
  for (int i = 0; i < parameters_.size(); ++i) {
    if (parameters_[i].kind != RigParameters::Kind::kFocal || !before.is_told[i] || !after.is_told[i])
      continue;
    const double difference = std::abs(after.values[i] - before.values[i]);
    const double sigmas = difference / std::hypot(before.sigma[i], after.sigma[i]);
    if (difference < kZoom || sigmas < std::max(kSurelyZoomed, *significance)) continue;
    *significance = sigmas;
    int camera = 0;
    while (!parameters_.concerns(i, camera)) ++camera;
    change =
        FocalChange{stretches[split - 1].end, parameters_.number(i, camera, parameters_.rig(before.values)),
                    parameters_.number(i, camera, parameters_.rig(after.values))};
  }
  return change;
}

// Of the key frames of a world before `end`.
std::vector<CalibrationRefiner::Stretch> CalibrationRefiner::short_stretches(const TrackingRig& rig,
                                                                             int world, const Map& map,
                                                                             const MotionOf& motion_of,
                                                                             int end) {
  std::vector<Stretch> stretches;
  for (int begin = 0; end - begin >= kLeastStretch; begin += kFirst)
    stretches.push_back(measured_stretch(rig, world, map, motion_of, begin, std::min(begin + kFirst, end),
                                         kPoints, Measure::kByNoise));
  return stretches;
}

bool CalibrationRefiner::drop_turning_shutter(const TrackingRig& rig, int world, const Map& map,
                                              const MotionOf& motion_of) {
  if (!parameters_.has_readout() || shutter_is_dropped_) return false;
  std::vector<double> least(parameters_.size(), 0), most(parameters_.size(), 0);
  for (const Stretch& s :
       short_stretches(rig, world, map, motion_of, static_cast<int>(map.keyframes.size()))) {
    const CalibrationChoice choice = choose(s.evidence);
    for (int i = 0; i < parameters_.size(); ++i) {
      if (parameters_[i].kind != RigParameters::Kind::kReadout || choice.significance[i] < kSurelyScanned)
        continue;
      least[i] = std::min(least[i], choice.values[i]);
      most[i] = std::max(most[i], choice.values[i]);
    }
  }
  for (int i = 0; i < parameters_.size(); ++i) shutter_is_dropped_ |= least[i] < 0 && most[i] > 0;
  return shutter_is_dropped_;
}

// The first stretch hides what changed within it: it is measured in short ones.
std::optional<FocalChange> CalibrationRefiner::focal_change(const TrackingRig& rig, int world, const Map& map,
                                                            const MotionOf& motion_of) {
  if (how_ == LensRefinement::kOff || parameters_.size() == 0) return std::nullopt;
  const int count = static_cast<int>(map.keyframes.size());
  std::vector<Stretch> stretches = short_stretches(rig, world, map, motion_of, std::min(count, kLongest));
  std::ranges::copy_if(stretches_, std::back_inserter(stretches),
                       [&](const Stretch& s) { return s.world == world && s.begin >= kLongest; });
  std::ranges::sort(stretches, {}, &Stretch::end);
  std::optional<FocalChange> surest;
  double significance = 0;
  for (size_t split = 1; split < stretches.size(); ++split) {
    if (const auto change = change_at(stretches, split, &significance)) surest = change;
  }
  return surest;
}

std::optional<Rig> CalibrationRefiner::chosen_rig() const {
  Rig rig = parameters_.rig(choice_.values);
  return can_be(rig) ? std::optional(std::move(rig)) : std::nullopt;
}

bool CalibrationRefiner::is_shutter_due(int keyframes, bool last) const {
  if (how_ == LensRefinement::kOff || !parameters_.has_readout() || has_found_shutter()) return false;
  if (last) return keyframes >= kLeastStretch && keyframes <= kMostForShutter && !shutter_is_dropped_;
  return keyframes == kShutterKeyFrames && stretches_.empty();
}

// By as many points as are measured where a shutter is known to roll: of ten each, sixteen key frames of a
// fisheye's walk tell nothing of a readout of 10 ms, which is 11 standard deviations by eighty.
std::optional<Rig> CalibrationRefiner::find_shutter(const TrackingRig& rig, int world, const Map& map,
                                                    const MotionOf& motion_of) {
  const int count = static_cast<int>(map.keyframes.size());
  const Stretch all = measured_stretch(rig, world, map, motion_of, 0, count, kPointsScanned);
  CalibrationChoice choice = within_reach(parameters_, values_, choose(all.evidence));
  for (int i = 0; i < parameters_.size(); ++i) {
    const bool is_readout = parameters_[i].kind == RigParameters::Kind::kReadout;
    if (!is_readout || choice.values[i] == 0 || !is_worth_it(choice)) continue;
    choice_ = std::move(choice);
    return chosen_rig();
  }
  return std::nullopt;
}

void CalibrationRefiner::set_frame_interval(double seconds) {
  constexpr double kMost = 1.2;  // of an interval: estimates have errors
  longest_readout_ = kMost * seconds;
}

double CalibrationRefiner::greatest_effect() const {
  const Eigen::VectorXd change = choice_.values - values_;
  double most = 0;
  for (const Stretch& s : stretches_) {
    const CalibrationEvidence& e = s.evidence;
    most = std::max(most, change.dot(e.information * change) / std::max(1, e.observations));
  }
  return std::sqrt(most);
}

bool CalibrationRefiner::has_readout(const Eigen::VectorXd& values) const {
  for (int i = 0; i < parameters_.size(); ++i) {
    if (parameters_[i].kind == RigParameters::Kind::kReadout && values[i] != 0) return true;
  }
  return false;
}

// What was said of a calibration that was far from the new one does not count.
bool CalibrationRefiner::take_over() {
  values_ = choice_.values;
  contradicts_ = choice_.contradicts;
  const bool is_far = choice_.effect > kFar || choice_.is_part;
  if (is_far) stretches_.clear();
  return is_far;
}

// Standard deviation of an unknown from where it is now. One that is kept, though another is likelier by less
// than it takes to be changed, is as far off as that one besides.
double CalibrationRefiner::deviation(int i) const {
  return choice_.is_told[i] ? std::hypot(choice_.sigma[i], choice_.likeliest[i] - values_[i])
                            : choice_.sigma[i];
}

// One that is kept, though another is likelier, is as far off as that one besides.
std::vector<Rig> CalibrationRefiner::deviations() const {
  std::vector<int> told;
  for (int i = 0; i < parameters_.size(); ++i) {
    if (choice_.is_told[i] && parameters_[i].kind != RigParameters::Kind::kReadout) told.push_back(i);
  }
  if (how_ == LensRefinement::kOff || told.empty()) return {};
  const Eigen::VectorXd off = (choice_.likeliest - values_)(told);
  const Eigen::MatrixXd covariance = choice_.covariance(told, told) + off * off.transpose();
  const Eigen::MatrixXd columns = covariance.llt().matrixL();
  std::vector<Rig> rigs;
  for (Eigen::Index k = 0; k < columns.cols(); ++k) {
    Eigen::VectorXd values = values_;
    values(told) += columns.col(k);
    rigs.push_back(parameters_.rig(values));
  }
  return rigs;
}

// Changes of a camera that differs from the first by its own add up.
CalibrationNumber CalibrationRefiner::number(int i, int camera, const Rig& present) const {
  CalibrationNumber n{.camera = camera, .name = parameters_.name(i)};
  n.given = parameters_.number(i, camera, parameters_.given());
  n.refined = parameters_.number(i, camera, present);
  n.told = true;
  double variance = 0;
  using Kind = RigParameters::Kind;
  for (int j = 0; j < parameters_.size(); ++j) {
    const bool is_part = parameters_.name(j) == n.name ||
                         (parameters_[i].kind == Kind::kAspect && parameters_[j].kind == Kind::kFocal);
    if (!is_part || !parameters_.concerns(j, camera)) continue;
    const bool is_factor = parameters_[j].kind == Kind::kFocal || parameters_[j].kind == Kind::kAspect;
    variance += std::pow(deviation(j) * (is_factor ? n.refined : 1.0), 2);
    n.told = n.told && choice_.is_told[j];
    n.significance = std::max(n.significance, choice_.significance[j]);
  }
  n.sigma = std::sqrt(variance);
  return n;
}

std::vector<CalibrationNumber> CalibrationRefiner::numbers() const {
  std::vector<CalibrationNumber> all;
  if (how_ == LensRefinement::kOff) return all;
  const Rig present = parameters_.rig(values_);
  for (int c = 0; c < static_cast<int>(present.cameras.size()); ++c) {
    std::set<std::string> seen;
    for (int i = 0; i < parameters_.size(); ++i) {
      if (parameters_.concerns(i, c) && seen.insert(parameters_.name(i)).second)
        all.push_back(number(i, c, present));
    }
  }
  return all;
}

}  // namespace raysfm
