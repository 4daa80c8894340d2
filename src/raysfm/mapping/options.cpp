#include "raysfm/mapping/options.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "raysfm/bundle/local_bundle.h"

namespace raysfm {
namespace {

Result<void> at_least(const char* field, int value, int least) {
  if (value >= least) return {};
  return bad_input(fmt::format("{} = {}: must be at least {}", field, value, least));
}

}  // namespace

Result<void> leave_out(std::string_view names, Departures* departures) {
  static constexpr std::pair<std::string_view, bool Departures::*> kNames[] = {
      {"blur", &Departures::blur},           {"earlier", &Departures::earlier},
      {"keyframes", &Departures::keyframes}, {"noise", &Departures::noise},
      {"parallax", &Departures::parallax},   {"surfaces", &Departures::surfaces},
      {"turning", &Departures::turning}};
  while (!names.empty()) {
    const std::string_view name = names.substr(0, names.find(','));
    const auto found = std::ranges::find(kNames, name, [](const auto& known) { return known.first; });
    if (found == std::end(kNames)) {
      return bad_input(fmt::format(
          "--without = {}: must be some of blur, earlier, keyframes, noise, parallax, surfaces, turning",
          name));
    }
    departures->*found->second = false;
    names.remove_prefix(std::min(names.size(), name.size() + 1));
  }
  return {};
}

Result<void> validate(const OdometryOptions& o) {
  struct Bound {
    const char* field;
    int value, least;
  };
  for (const Bound& b : {Bound{"--features", o.features, 50}, Bound{"--min-matches", o.min_matches, 30},
                         Bound{"--global-until", o.global_until, 3}}) {
    if (auto r = at_least(b.field, b.value, b.least); !r) return r;
  }
  constexpr int kMaxFeatures = 100000;  // also keeps twice the number a number
  if (o.features > kMaxFeatures) {
    return bad_input(fmt::format("--features = {}: must be at most {}", o.features, kMaxFeatures));
  }
  if (o.error == ErrorMeasure::kAngularPlain && o.refine_lens == LensRefinement::kOn) {
    return bad_input(
        "--refine-lens = on: must be auto or off with --error angular-plain, which tells no lens");
  }
  return validate(LocalBundleOptions{o.free_cameras, o.window, o.global_until, o.paper_window});
}

}  // namespace raysfm
