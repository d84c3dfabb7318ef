// Writes sparse models, as all versions of COLMAP read them.

#pragma once

#include "colmap_ext/output_file.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <string>
#include <vector>

namespace dgsfm {

// The files of a model.
constexpr const char* kModelFiles[] = {
    "cameras.bin", "images.bin", "points3D.bin"};

// One file of a model, which has its name after Commit(); its numbers are
// finite.
class ModelFile {
 public:
  ModelFile(const std::string& folder,
            const std::string& name,
            size_t num_records);

  template <typename T>
  void Write(T number) {
    file_.WriteNumber(number);
  }
  // `owner` is what the numbers belong to, for the message.
  void WriteVector(const Eigen::Ref<const Eigen::VectorXd>& numbers,
                   const std::string& owner);
  void WriteName(const std::string& name);
  void Commit() { file_.Commit(); }

 private:
  const std::string path_;
  OutputFile file_;
};

// images.bin, image after image.
class ModelImagesFile {
 public:
  ModelImagesFile(const std::string& folder, size_t num_images);
  // Begins an image, whose key points are added next.
  void AddImage(const colmap::Image& image, size_t num_points2D);
  void AddPoint2D(const Eigen::Vector2d& xy, colmap::point3D_t point3D_id);
  void Commit() { file_.Commit(); }

 private:
  ModelFile file_;
  std::string owner_;
};

// points3D.bin, point after point.
class ModelPointsFile {
 public:
  ModelPointsFile(const std::string& folder, size_t num_points);
  void AddPoint(colmap::point3D_t point3D_id, const colmap::Point3D& point);
  void Commit() { file_.Commit(); }

 private:
  ModelFile file_;
};

// Writes cameras.bin. Throws as WriteModel().
void WriteModelCameras(const colmap::Reconstruction& model,
                       const std::string& folder);

// Writes cameras.bin, images.bin and points3D.bin with the registered images,
// in the order of the ids, into a folder that exists.
//
// Beside colmap::Reconstruction::Write because that checks no stream: a full
// disk truncates its files without a word. Throws std::runtime_error naming
// the file that cannot be written, or the camera, image or point that has a
// number that is not finite.
void WriteModel(const colmap::Reconstruction& model, const std::string& folder);

}  // namespace dgsfm
