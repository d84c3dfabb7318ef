#include "sfm/mapping/stray_points.h"

#include "colmap_ext/parallel.h"
#include "sfm/mapping/model_access.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <utility>
#include <vector>

#include <boost/geometry.hpp>
#include <boost/geometry/geometries/point.hpp>
#include <boost/geometry/index/rtree.hpp>

namespace dgsfm {

namespace {

namespace bg = boost::geometry;

// Neighbours of which one has to be at about the same distance.
constexpr int kNumNeighbors = 5;

using Position = bg::model::point<double, 2, bg::cs::cartesian>;
// Position of a feature and distance of its point.
using Neighbor = std::pair<Position, double>;
using NeighborTree = bg::index::rtree<Neighbor, bg::index::quadratic<16>>;

struct Candidate {
  Position position;
  double distance;
  colmap::point3D_t point_id;
};

bool IsStray(const NeighborTree& tree,
             const Candidate& candidate,
             double max_ratio) {
  std::vector<Neighbor> neighbors;
  // Features of several orientations share their position, and their matches.
  const auto is_elsewhere = [&](const Neighbor& neighbor) {
    return !bg::equals(neighbor.first, candidate.position);
  };
  tree.query(bg::index::nearest(candidate.position, kNumNeighbors) &&
                 bg::index::satisfies(is_elsewhere),
             std::back_inserter(neighbors));
  return !neighbors.empty() &&
         std::none_of(
             neighbors.begin(), neighbors.end(), [&](const Neighbor& neighbor) {
               return std::max(candidate.distance, neighbor.second) <=
                      max_ratio * std::min(candidate.distance, neighbor.second);
             });
}

// Points of two images that are stray in this one.
std::vector<colmap::point3D_t> StrayPointsOf(
    const ModelRefinementOptions& options,
    const ImageCenters& centers,
    const colmap::Reconstruction& model,
    colmap::image_t image_id) {
  const double min_angle = options.min_triangulation_angle_deg * M_PI / 180;
  const Eigen::Vector3d& center = centers.at(image_id);
  std::vector<Neighbor> neighbors;
  std::vector<Candidate> candidates;
  for (const colmap::Point2D& feature : model.Image(image_id).Points2D()) {
    if (!feature.HasPoint3D()) continue;
    const colmap::Point3D& point = model.Point3D(feature.Point3DId());
    const Position position(feature.X(), feature.Y());
    const double distance = (point.XYZ() - center).norm();
    neighbors.emplace_back(position, distance);
    if (point.Track().Length() == 2 &&
        IsTriangulated(point, centers, min_angle)) {
      candidates.push_back({position, distance, feature.Point3DId()});
    }
  }
  std::vector<colmap::point3D_t> stray;
  if (candidates.empty() ||
      neighbors.size() - candidates.size() <
          size_t(options.min_num_triangulated_per_image)) {
    return stray;
  }
  const NeighborTree tree(neighbors);
  for (const Candidate& candidate : candidates) {
    if (IsStray(tree, candidate, options.max_neighbor_distance_ratio))
      stray.push_back(candidate.point_id);
  }
  return stray;
}

}  // namespace

size_t RemoveStrayPoints(const ModelRefinementOptions& options,
                         int num_threads,
                         colmap::Reconstruction* model) {
  if (options.max_neighbor_distance_ratio == 0) return 0;
  const ImageCenters centers = CentersOf(*model);
  const std::vector<colmap::image_t> image_ids = SortedRegisteredImages(*model);
  std::vector<std::vector<colmap::point3D_t>> stray(image_ids.size());
  ParallelFor(image_ids.size(), num_threads, [&](size_t i) {
    stray[i] = StrayPointsOf(options, centers, *model, image_ids[i]);
  });
  std::set<colmap::point3D_t> point_ids;
  for (const auto& ids : stray) point_ids.insert(ids.begin(), ids.end());
  size_t num_observations = 0;
  for (const colmap::point3D_t point_id : point_ids) {
    num_observations += model->Point3D(point_id).Track().Length();
    model->DeletePoint3D(point_id);
  }
  return num_observations;
}

}  // namespace dgsfm
