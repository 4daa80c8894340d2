#pragma once

#include "raysfm/synth/shade.h"

namespace raysfm::synth {

constexpr float kStainPeriod = 37.f;  // metres
constexpr float kGrainPeriod = 1.3f;
constexpr float kMostProbes = 6.f;  // lookups along the longer diameter of a spot
constexpr int kTile = 256;          // rays shaded at a time
constexpr float kOnes[3] = {1.f, 1.f, 1.f};

// The places on surfaces that the rays of a tile meet, and how these are painted.
struct Spots {
  static constexpr int kRoom = kTile + kRayPack;
  // Metres along the two directions of the surface, and the part of it that a ray stands for: an ellipse
  // whose two diameters are the steps `along`, the way the ray leans, and `across`.
  float u[kRoom] = {}, v[kRoom] = {};
  float along_u[kRoom] = {}, along_v[kRoom] = {}, across_u[kRoom] = {}, across_v[kRoom] = {};
  float light[kRoom] = {};
  // The members of Paint.
  float per_u[kRoom] = {}, per_v[kRoom] = {}, begin_u[kRoom] = {}, begin_v[kRoom] = {};
  float noise_u[kRoom] = {}, noise_v[kRoom] = {}, red[kRoom] = {}, green[kRoom] = {}, blue[kRoom] = {};
  float stains[kRoom] = {}, grain[kRoom] = {};
  int32_t first_texel[kRoom] = {}, side_log2[kRoom] = {};
};

// A finish as the lookup needs it.
struct Paint {
  float per_u, per_v;      // periods of the texture per metre
  float begin_u, begin_v;  // periods at the surface's corner
  float noise_u, noise_v;  // the same of the weathering
  float red, green, blue;  // tint
  float stains, grain;
  int32_t first_texel, side_log2;
};

// `width`, `height`: metres of the surface that a fitted texture fills.
Paint paint_of(const World& world, const Finish& finish, float width, float height);

// Where the rays [begin, end) of a row meet one ellipsoid; `to` is the place of `begin` among the spots.
void place_on_ellipsoid(const World& world, const Scene& scene, const SightRow& sights, int begin, int end,
                        Spots& spots, int to);

}  // namespace raysfm::synth
