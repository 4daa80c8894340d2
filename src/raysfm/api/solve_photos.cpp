#include "raysfm/api/solve_photos.h"

#include <algorithm>
#include <array>
#include <numeric>
#include <optional>

#include "raysfm/io/frame_source.h"
#include "raysfm/io/photo_features.h"
#include "raysfm/uncalibrated/view_pair.h"

namespace raysfm {
namespace {

constexpr int kMinShared = 40;
constexpr int kFeatures = 2500;
constexpr int kMinPairInliers = 20;

// Sets of features that are the same point.
class Merger {
 public:
  explicit Merger(int count) : parent_(count) { std::iota(parent_.begin(), parent_.end(), 0); }
  int root(int i) {
    while (parent_[i] != i) i = parent_[i] = parent_[parent_[i]];
    return i;
  }
  void join(int i, int j) { parent_[root(i)] = root(j); }

 private:
  std::vector<int> parent_;
};

// Features of all photos in one row.
struct Photos {
  PhotoFeatures features;
  std::vector<int> first;  // feature of each photo
  std::vector<std::array<uint8_t, 3>> rgb;
};

Result<void> read_photos(FrameSource& source, Photos* photos, SolveInput* input) {
  for (;;) {
    Result<std::optional<InputFrame>> next = source.next();
    if (!next) return next.error();
    if (!*next) return {};
    const InputFrame& frame = **next;
    photos->features.add(frame.gray.view(), kFeatures);
    photos->first.push_back(static_cast<int>(photos->rgb.size()));
    for (const Eigen::Vector2d& p : photos->features.pixels(photos->features.photos() - 1)) {
      const int x = std::clamp(static_cast<int>(p.x() + 0.5), 0, frame.gray.width() - 1);
      const int y = std::clamp(static_cast<int>(p.y() + 0.5), 0, frame.gray.height() - 1);
      const uint8_t grey = frame.gray.row(y)[x];
      const uint8_t* bgr = frame.bgr.empty() ? nullptr : frame.bgr.row(y) + 3 * x;
      photos->rgb.push_back(bgr ? std::array{bgr[2], bgr[1], bgr[0]} : std::array{grey, grey, grey});
    }
    input->timestamps.push_back(frame.timestamp);
    input->names.push_back(frame.name);
    input->keyframe.push_back(1);
    input->tracks.image_size = {frame.gray.width(), frame.gray.height()};
  }
}

void join_pair(const Photos& photos, int a, int b, double max_error, uint64_t seed, Merger* merger) {
  const std::vector<std::pair<int, int>> found = photos.features.match(a, b);
  PairMatches matches;
  for (size_t i = 0; i < found.size(); ++i) {
    matches.points.push_back(static_cast<int>(i));
    matches.a.push_back(photos.features.pixels(a)[found[i].first]);
    matches.b.push_back(photos.features.pixels(b)[found[i].second]);
  }
  ViewPair pair;
  const auto stream = static_cast<uint64_t>(a * kMaxPhotos + b);
  if (!fundamental_ransac(matches, max_error, 2000, seed, stream, &pair)) return;
  if (pair.inliers < kMinPairInliers) return;
  for (size_t i = 0; i < pair.inlier.size(); ++i) {
    if (!pair.inlier[i]) continue;
    const auto& [in_a, in_b] = found[pair.matches.points[i]];
    merger->join(photos.first[a] + in_a, photos.first[b] + in_b);
  }
}

// A set with two features of one photo is two points, and which is which is not known: it is left out.
void collect_tracks(const Photos& photos, Merger* merger, SolveInput* input) {
  const int count = static_cast<int>(photos.rgb.size());
  std::vector<int> last_photo(count, -1), size(count, 0), number(count, -1);
  for (int j = 0; j < photos.features.photos(); ++j) {
    for (size_t i = 0; i < photos.features.pixels(j).size(); ++i) {
      const int root = merger->root(photos.first[j] + static_cast<int>(i));
      size[root] = last_photo[root] == j || size[root] < 0 ? -1 : size[root] + 1;
      last_photo[root] = j;
    }
  }
  PointTracks& tracks = input->tracks;
  tracks.image_count = photos.features.photos();
  for (int j = 0; j < tracks.image_count; ++j) {
    for (size_t i = 0; i < photos.features.pixels(j).size(); ++i) {
      const int root = merger->root(photos.first[j] + static_cast<int>(i));
      if (size[root] < 2) continue;
      if (number[root] < 0) {
        number[root] = tracks.point_count++;
        input->rgb.push_back(photos.rgb[root]);
      }
      tracks.add(j, number[root], photos.features.pixels(j)[i]);
    }
  }
}

}  // namespace

bool looks_like_photos(const SolveInput& video) {
  const int images = video.tracks.image_count;
  if (images > kMaxPhotos) return false;
  std::vector<int> shared(images, 0), last(video.tracks.point_count, -2);
  for (int k = 0; k < video.tracks.size(); ++k) {  // in the order of the images
    const int image = video.tracks.image[k];
    int& before = last[video.tracks.point[k]];
    shared[image] += before == image - 1;
    before = image;
  }
  return images > 1 && *std::min_element(shared.begin() + 1, shared.end()) < kMinShared;
}

Result<SolveInput> tracks_from_photos(const SolveSettings& settings, const SolveCallbacks& callbacks) {
  Result<Input> opened =
      open_input({settings.input}, {.fps = settings.fps, .mono = true, .ignore_calibration = true});
  if (!opened) return opened.error();
  SolveInput input;
  Photos photos;
  if (auto r = read_photos(*opened->streams[0], &photos, &input); !r) return r.error();
  Merger merger(static_cast<int>(photos.rgb.size()));
  for (int a = 0; a < photos.features.photos(); ++a) {
    for (int b = a + 1; b < photos.features.photos(); ++b) {
      input.interrupted = callbacks.stop && callbacks.stop->load();
      if (!input.interrupted) join_pair(photos, a, b, settings.max_error, settings.seed, &merger);
    }
  }
  collect_tracks(photos, &merger, &input);
  return input;
}

}  // namespace raysfm
