// Correspondences of dense matchers (RoMa, LoFTR, MASt3R) in files: positions
// in floating point, one group of arrays per image pair.

#pragma once

#include "colmap_ext/depth/depth_map_io.h"

#include <map>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

namespace dgsfm {

// Points of the first and the second image [px] and, where the file has them,
// confidences: all of the same length.
struct DenseMatches {
  std::vector<Eigen::Vector2f> points1;
  std::vector<Eigen::Vector2f> points2;
  std::vector<float> confidences;
};

// Open files. A path is
// - an HDF5 file (.h5, .hdf5) with a group per pair,
// - a NumPy archive with arrays "GROUP/ARRAY", or
// - a folder of NumPy archives "GROUP.npz", sub-folders included.
// The arrays of a group are keypoints0 and keypoints1, or mkpts0 and mkpts1,
// each N x 2, or matches, N x 4, and optionally confidence, certainty, mconf or
// scores, N.
//
// Methods throw std::runtime_error naming the file, and the group where there
// is one. Not thread-safe.
class DenseMatchFile {
 public:
  explicit DenseMatchFile(const std::string& path);
  // Arrays in memory by the names of groups; `path` is their name in messages.
  DenseMatchFile(const std::string& path,
                 std::map<std::string, ArrayReader> arrays);
  ~DenseMatchFile();

  const std::string& Path() const { return path_; }
  // Sorted.
  const std::vector<std::string>& Groups() const;
  DenseMatches Read(const std::string& group) const;

  struct Impl;

 private:
  std::string path_;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dgsfm
