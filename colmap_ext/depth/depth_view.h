// A depth map with the camera that took it.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "colmap_ext/rigid3.h"

#include <colmap/util/alignment.h>

#include <colmap/base/camera.h>

#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// A depth map in the unit of the poses, which covers its image.
class DepthView {
 public:
  // `stddev`: of the relative errors of the depths. Throws
  // std::invalid_argument if it is not above 0.
  DepthView(const colmap::Camera& camera,
            const Rigid3d& cam_from_world,
            DepthMap map,
            double stddev);

  const Rigid3d& CamFromWorld() const { return cam_from_world_; }
  const DepthMap& Map() const { return map_; }
  double Stddev() const { return stddev_; }

  // Ray through the centre of a pixel of the map in the camera frame, z = 1.
  Eigen::Vector3d Ray(int x, int y) const;
  // Place of a point of the camera frame, z > 0, in pixels of the map.
  Eigen::Vector2d Project(const Eigen::Vector3d& xyz) const;
  bool Covers(const Eigen::Vector2d& place) const;
  // Inverse depth at such a place, linear between the centres of pixels as it
  // is on planes; 0 outside, where it is unknown, and at edges.
  double InverseDepthAt(const Eigen::Vector2d& place) const;
  // The plane n X = 1 of the camera frame that fits the surface around a pixel
  // of known depth; zero if most of the pixels around are of other surfaces.
  Eigen::Vector3d TangentPlane(int x, int y) const;
  // Least depth of a pixel and those around it; 0 if one of them is unknown.
  float LeastDepthAround(int x, int y) const;
  // Whether the surface before which a pixel of known depth lies is nearer, or
  // a pixel around has no depth.
  bool IsAtEdge(int x, int y) const;

 private:
  colmap::Camera camera_;
  Rigid3d cam_from_world_;
  DepthMap map_;
  double stddev_;
  // Rays of every few pixels, between which they are linear enough.
  int num_ray_cols_ = 0;
  std::vector<Eigen::Vector2d> rays_;
};

}  // namespace dgsfm
