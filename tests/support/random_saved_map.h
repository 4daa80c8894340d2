#pragma once

#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "raysfm/core/random.h"
#include "raysfm/saved_map/saved_map.h"
#include "support/random_vectors.h"

namespace raysfm::testing_support {

inline Rigid3 random_pose(Rng& rng) {
  return {exp_so3(normal_vector(rng)), 10 * normal_vector(rng)};
}

inline ObservedRay random_ray(Rng& rng) {
  ObservedRay ray;
  ray.origin = normal_vector(rng);
  ray.direction = normal_vector(rng).normalized();
  for (const int row : {0, 1}) ray.tangents.row(row) = normal_vector(rng);
  return ray;
}

inline Rig random_rig(Rng& rng) {
  Rig rig;
  for (const char* name : {"left", "right \"1\""}) {
    Camera camera;
    camera.name = name;
    camera.model = Pinhole{500.0 / 3, 510.1, 319.7 + rng.normal(), 239.9};
    camera.width = 640, camera.height = 480;
    camera.rig_from_cam = random_pose(rng);
    camera.mask_path = "masks/m.png";
    rig.cameras.push_back(camera);
  }
  rig.cameras[1].stream = 1;
  return rig;
}

// A key frame of features that no track has yet.
inline void add_random_keyframe(int features, bool angular, Rng& rng, SavedWorld* world) {
  MapKeyFrame& k = world->map.keyframes.emplace_back();
  k.frame = 7 * static_cast<int>(world->map.keyframes.size());
  k.rig_from_world = random_pose(rng);
  for (int f = 0; f < features; ++f) {
    const Eigen::Vector2f pixel(static_cast<float>(rng.uniform(0, 639)),
                                static_cast<float>(rng.uniform(0, 479)));
    k.add(f % 2, pixel, static_cast<int>(rng.index(4)), -1);
    k.inliers.back() = static_cast<uint8_t>(rng.index(2));
    if (angular) k.rays.push_back(random_ray(rng));
    if (f % 3 != 0) continue;
    k.described.push_back(f);
    k.descriptors.push_back({{rng.next(), rng.next(), rng.next(), rng.next()}});
  }
  world->sources.push_back({rng.uniform(0, 1e9), "image " + std::to_string(rng.index(1000)) + ".png"});
}

// Feature f of each key frame may belong to track f; every ninth track is free.
inline void add_random_tracks(int tracks, Rng& rng, Map* map) {
  for (int t = 0; t < tracks; ++t) {
    Track& track = map->tracks.emplace_back();
    if (t % 9 == 8) {
      map->free_tracks.insert(map->free_tracks.begin(), t);
      continue;
    }
    track.position = 100 * normal_vector(rng);
    track.triangulated = rng.index(2) == 1;
    track.had_position = rng.index(2) == 1;
    for (uint8_t& channel : track.rgb) channel = static_cast<uint8_t>(rng.index(256));
    for (size_t k = 0; k < map->keyframes.size(); ++k) {
      if (t >= map->keyframes[k].size() || rng.index(3) == 0) continue;
      map->keyframes[k].tracks[t] = t;
      map->observe(t, static_cast<int>(k), t);
    }
  }
}

// Two worlds that have something in every field, the second angular and with an unknown scale, and an empty
// one.
inline SavedMap random_saved_map(uint64_t seed, int keyframes = 4, int features = 50) {
  Rng rng(seed);
  SavedMap saved;
  saved.rig = random_rig(rng);
  for (const bool angular : {false, true}) {
    SavedWorld& world = saved.worlds.emplace_back();
    for (int k = 0; k < keyframes; ++k) add_random_keyframe(features + k, angular, rng, &world);
    add_random_tracks(features, rng, &world.map);
    if (!angular) world.map.scale_sigma = rng.uniform();
    world.map.guessed_keyframe = angular ? keyframes - 1 : -1;
    world.map.guessed_distance = rng.uniform();
    world.map.rescaled = std::exp(rng.normal());
  }
  saved.worlds.emplace_back();
  return saved;
}

}  // namespace raysfm::testing_support
