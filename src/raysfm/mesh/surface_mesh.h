#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <vector>

namespace raysfm {

// Triangles with shared vertices. Seen from outside, from where the cameras are, the vertices of a face turn
// counter-clockwise. Edge e of a face leads from its vertex e to vertex (e + 1) % 3.
struct SurfaceMesh {
  std::vector<Eigen::Vector3d> positions;
  std::vector<int> points;                 // by vertex: the SurfacePoint that it is
  std::vector<std::array<int, 3>> faces;   // vertices
  std::vector<std::array<int, 3>> beyond;  // by face and edge: 3 * face + edge on the other side, -1: border
};

// Takes the faces away for which `keep` is 0; vertices that no face has any more go too, and those that hold
// separate fans of faces become one for each fan. Then every edge has one face or two, and every vertex one
// fan, whatever the mesh was.
void keep_faces(const std::vector<uint8_t>& keep, SurfaceMesh* mesh);

// Number of the piece that each face belongs to; faces that share an edge are of one piece.
std::vector<int> pieces_of(const SurfaceMesh& mesh);

double face_area(const SurfaceMesh& mesh, int face);
Eigen::Vector3d face_normal(const SurfaceMesh& mesh, int face);  // unit, outwards; zero without area
double longest_edge(const SurfaceMesh& mesh, int face);

// Moves vertices towards the mean of their neighbours, no farther than `reach` of each, which takes the noise
// off flat places. Vertices of the border stay.
void smooth(const std::vector<double>& reach, int rounds, SurfaceMesh* mesh);

}  // namespace raysfm
