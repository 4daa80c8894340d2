// Milliseconds that a key frame costs when it is asked where it was before: search in an index of many
// places, and the comparison with one of them in full. Descriptors are those of real views, of their mirror
// images and of their negatives, so that they say as little of each other as those of real places do. Usage:
// places_benchmark [PLACES...], default 100 1000 5000 20000
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>

#include "raysfm/features/harris.h"
#include "raysfm/frames/frame_source.h"
#include "raysfm/places/place_index.h"
#include "support/shared_data.h"

namespace {

using namespace raysfm;
using testing_support::shared_data;

constexpr int kDescriptors = 600;
constexpr const char* kInputs[] = {"kitti07-mono", "tsukuba-mono", "redkitchen-handheld", "fr1-rpy",
                                   "kitti00-small/video.mp4"};

// Of the processor: other programs may be running.
double processor_ms() {
  return 1e3 * static_cast<double>(std::clock()) / CLOCKS_PER_SEC;
}

GrayImage changed(const GrayImage& image, bool mirrored, bool negative) {
  GrayImage out(image.width(), image.height());
  for (int y = 0; y < image.height(); ++y) {
    const uint8_t* from = image.row(y);
    uint8_t* to = out.row(y);
    std::copy_n(from, image.width(), to);
    if (mirrored) std::reverse(to, to + image.width());
    if (negative) std::transform(to, to + image.width(), to, [](uint8_t v) { return uint8_t(255 - v); });
  }
  return out;
}

std::vector<Descriptor> describe(GrayImage image) {
  const Octaves octaves(std::move(image), 5 << 19);
  Features corners;
  HarrisDetector().detect(octaves.at(octaves.first()),
                          {.max_features = kDescriptors, .octave = octaves.first()}, &corners);
  Describer describer;
  DescriptorSet set;
  describer.describe(octaves, corners.pixels, corners.octaves, &set);
  return set.descriptors;
}

std::vector<std::vector<Descriptor>> all_views() {
  std::vector<std::vector<Descriptor>> views;
  for (const char* name : kInputs) {
    Result<Input> input = open_input({shared_data(name).string()}, {.mono = true});
    if (!input) {
      std::printf("skipped: %s\n", input.error().message.c_str());
      continue;
    }
    for (;;) {
      Result<std::optional<InputFrame>> frame = input->streams[0]->next();
      if (!frame || !*frame) break;
      for (const int change : {0, 1, 2, 3}) {
        views.push_back(describe(changed((*frame)->gray, (change & 1) != 0, (change & 2) != 0)));
      }
    }
  }
  return views;
}

void benchmark(const std::vector<std::vector<Descriptor>>& views, int places) {
  PlaceIndex index;
  double start = processor_ms();
  for (int p = 0; p < places; ++p) index.add(views[p % views.size()]);
  const double add_ms = (processor_ms() - start) / places;
  constexpr int kAsked = 50;
  std::vector<double> ms;
  int votes = 0;
  for (int i = 0; i < kAsked; ++i) {
    const std::vector<Descriptor>& asked = views[(7919 * i + 3) % views.size()];
    start = processor_ms();
    for (const PlaceVotes& v : index.search(asked, {}, 3)) votes += v.votes;
    ms.push_back((processor_ms() - start));
  }
  std::ranges::sort(ms);
  std::printf("%6d places: %.3f ms to add one, %.2f ms to search (median; longest %.2f), %d votes\n", places,
              add_ms, ms[kAsked / 2], ms.back(), votes);
}

// How many views that were taken between two of the places have one of these among the three of most votes,
// with a part of their descriptors.
void recall(const std::vector<std::vector<Descriptor>>& views, int places, int descriptors) {
  constexpr size_t kStep = 10 * 4;  // frames are numbered by their four changes
  PlaceIndex index;
  for (size_t v = 0; v < views.size(); v += kStep) index.add(views[v]);
  for (int p = 0; index.size() < places; ++p) {
    if (p % 4 != 0) index.add(views[p % views.size()]);
  }
  int asked = 0, found = 0;
  double ms = 0;
  for (size_t v = kStep / 2; v < views.size(); v += kStep, ++asked) {
    std::vector<Descriptor> some;
    for (int i = 0; i < descriptors; ++i) some.push_back(views[v][views[v].size() * i / descriptors]);
    const double start = processor_ms();
    const std::vector<PlaceVotes> votes = index.search(some, {}, 3);
    ms += (processor_ms() - start);
    const int before = static_cast<int>(v / kStep);
    found += std::ranges::any_of(
        votes, [&](const PlaceVotes& p) { return p.place == before || p.place == before + 1; });
  }
  std::printf("%6d places, %3d descriptors asked: %.1f %% of %d found, %.2f ms\n", places, descriptors,
              100.0 * found / asked, asked, ms / asked);
}

}  // namespace

int main(int argc, char** argv) {
  const auto views = all_views();
  std::printf("%zu views\n", views.size());
  std::vector<int> sizes;
  for (int i = 1; i < argc; ++i) sizes.push_back(std::atoi(argv[i]));
  if (sizes.empty()) sizes = {100, 1000, 5000, 20000};
  for (const int places : sizes) benchmark(views, places);
  for (const int places : sizes) {
    for (const int descriptors : {600, 300, 150}) recall(views, places, descriptors);
  }
}
