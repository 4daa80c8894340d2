#include "raysfm/robust/rig_table.h"

#include <algorithm>
#include <map>

namespace raysfm {

using Eigen::Vector3d;

namespace {

struct Entry {
  int point, view, camera, input;
};

std::vector<Entry> valid_entries(const RigMatches& matches) {
  std::vector<Entry> entries;
  const size_t count = matches.rays.size();
  if (matches.points.size() != count || matches.views.size() != count) return entries;
  if (!matches.cameras.empty() && matches.cameras.size() != count) return entries;
  entries.reserve(count);
  for (size_t i = 0; i < count; ++i) {
    const ObservedRay& ray = matches.rays[i];
    const int point = matches.points[i], view = matches.views[i];
    const int camera = matches.cameras.empty() ? 0 : matches.cameras[i];
    if (point < 0 || point >= matches.point_count || view < 0 || view > 2 || camera < 0) continue;
    if (!ray.origin.allFinite() || !ray.direction.allFinite() || !ray.tangents.allFinite()) continue;
    entries.push_back({point, view, camera, static_cast<int>(i)});
  }
  std::sort(entries.begin(), entries.end(), [](const Entry& a, const Entry& b) {
    return std::tie(a.point, a.view, a.camera, a.input) < std::tie(b.point, b.view, b.camera, b.input);
  });
  return entries;
}

// The camera with rays in most of the three views, the first of several.
int most_seen_camera(std::span<const Entry> entries) {
  int best = -1, best_views = 0;
  for (const Entry& candidate : entries) {
    int seen = 0;
    for (const Entry& entry : entries) seen |= entry.camera == candidate.camera ? 1 << entry.view : 0;
    const int views = (seen & 1) + (seen >> 1 & 1) + (seen >> 2 & 1);
    if (views > best_views) best_views = views, best = candidate.camera;
  }
  return best;
}

// False where a view has none.
bool choose_primary(std::span<const Entry> entries, RigTable::Point* point) {
  const int camera = most_seen_camera(entries);
  point->primary = {-1, -1, -1};
  point->camera = camera;
  for (const bool any : {false, true}) {
    for (int i = 0; i < static_cast<int>(entries.size()); ++i) {
      int& primary = point->primary[entries[i].view];
      if (primary >= 0 || (!any && entries[i].camera != camera)) continue;
      primary = point->begin + i;
      if (any) point->camera = -1;
    }
  }
  return *std::min_element(point->primary.begin(), point->primary.end()) >= 0;
}

void move_to_main_camera(RigTable* table) {
  std::map<int, int> counts;
  for (const RigTable::Point& point : table->points) ++counts[point.camera];
  counts.erase(-1);
  int most = 0, origins = 0;
  for (const auto& [camera, count] : counts) {
    if (count > most) most = count, table->main_camera = camera;
  }
  for (const RigTable::Point& point : table->points) {
    if (point.camera != table->main_camera) continue;
    for (const int i : point.primary) table->centre += table->rays[i].origin, ++origins;
  }
  if (origins > 0) table->centre /= origins;
  for (ObservedRay& ray : table->rays) ray.origin -= table->centre;
}

}  // namespace

RigTable make_rig_table(const RigMatches& matches) {
  const std::vector<Entry> entries = valid_entries(matches);
  RigTable table;
  for (size_t begin = 0, end; begin < entries.size(); begin = end) {
    end = begin + 1;
    while (end < entries.size() && entries[end].point == entries[begin].point) ++end;
    RigTable::Point point;
    point.index = entries[begin].point;
    point.begin = static_cast<int>(table.rays.size());
    point.end = point.begin + static_cast<int>(end - begin);
    const std::span<const Entry> own(entries.data() + begin, end - begin);
    if (!choose_primary(own, &point)) continue;
    for (const Entry& entry : own) {
      table.rays.push_back(matches.rays[entry.input]);
      table.views.push_back(entry.view);
    }
    point.weight1 = 0.5 * table.rays[point.primary[1]].tangents.squaredNorm();
    point.weight2 = 0.5 * table.rays[point.primary[2]].tangents.squaredNorm();
    table.points.push_back(point);
  }
  move_to_main_camera(&table);
  return table;
}

}  // namespace raysfm
