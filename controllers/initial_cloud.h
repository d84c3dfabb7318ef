// A model whose points are those of depth maps, as trainers of Gaussian
// splatting begin with.

#pragma once

#include "colmap_ext/depth/depth_map.h"
#include "controllers/sparse_model.h"

#include <map>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

class InitialCloud {
 public:
  // `model` has cameras and poses, image_ids the id of each of its images that
  // shall keep one. At most this many points [at least 1], of which each image
  // gives its share. The model must outlive this.
  InitialCloud(const SparseModel& model,
               const std::map<std::string, colmap::image_t>& image_ids,
               size_t max_num_points);

  // Takes pixels of a map that covers its image, evenly spread. Callable for
  // different images from any thread.
  void Add(const std::string& image_name, const DepthMap& depth_map);

  // Merges samples that are nearer to each other than they are apart in their
  // images, and writes the model, its points coloured by the images in
  // image_path, or black without. The same whatever the order of Add(). Returns
  // the number of points. Throws std::runtime_error naming the file.
  size_t Write(const std::string& output_path,
               const std::string& image_path,
               int num_threads) const;

 private:
  struct Sample {
    Eigen::Vector2d xy = Eigen::Vector2d::Zero();  // [px of the image]
    Eigen::Vector3d xyz = Eigen::Vector3d::Zero();
    double spacing = 0;  // of the samples there [unit of the model]
  };
  struct Image {
    colmap::image_t image_id = colmap::kInvalidImageId;
    std::vector<Sample> samples;
  };

  const SparseModel& model_;
  const size_t max_num_points_;
  std::map<std::string, Image> images_;
};

}  // namespace dgsfm
