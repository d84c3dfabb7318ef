#include "sfm/intrinsics/calibration_check.h"

#include "sfm/mapping/model_access.h"

#include <cmath>
#include <set>
#include <sstream>

namespace dgsfm {

namespace {

// Principal points of whole images are within 5 % of the centre; those of
// crops are off by any amount, but rarely by the same share of both sides.
constexpr double kMaxCenterOffset = 0.05;  // [image side]
constexpr double kMinWrongOffset = 0.1;    // [image side]
// From how far off a calibrated focal length is not that of the images
// [standard deviations of its prior].
constexpr double kMaxFocalDeviation = 4;

bool IsCentered(double coordinate, double side) {
  return std::abs(coordinate / side - 0.5) <= kMaxCenterOffset;
}

std::string CountCameras(const std::vector<colmap::camera_t>& camera_ids) {
  const std::string first = "camera " + std::to_string(camera_ids.front());
  if (camera_ids.size() == 1) return first;
  return std::to_string(camera_ids.size()) + " cameras, the first of them " +
         first + ",";
}

}  // namespace

std::vector<std::string> PrincipalPointAdvice(const CameraMap& cameras) {
  std::vector<colmap::camera_t> exchanged, of_other_size;
  for (const auto& [camera_id, camera] : cameras) {
    const double width = double(camera.Width());
    const double height = double(camera.Height());
    const double x = camera.PrincipalPointX();
    const double y = camera.PrincipalPointY();
    if (std::abs(x / width - 0.5) < kMinWrongOffset &&
        std::abs(y / height - 0.5) < kMinWrongOffset) {
      continue;
    }
    if (IsCentered(x, height) && IsCentered(y, width)) {
      exchanged.push_back(camera_id);
    } else if (std::abs(x / width - y / height) <= kMaxCenterOffset) {
      of_other_size.push_back(camera_id);
    }
  }
  std::vector<std::string> advice;
  if (!exchanged.empty()) {
    advice.push_back("The principal point of " + CountCameras(exchanged) +
                     " seems to have its coordinates exchanged: check the "
                     "order of the parameters (cx before cy)");
  }
  if (!of_other_size.empty()) {
    const colmap::Camera& camera = cameras.at(of_other_size.front());
    std::ostringstream text;
    text.precision(3);
    text << "The intrinsics of " << CountCameras(of_other_size)
         << " seem to be those of images "
         << 2 * camera.PrincipalPointX() / double(camera.Width())
         << " times as large as the " << camera.Width() << " x "
         << camera.Height()
         << " of the database: scale focal length and principal point with the "
            "images";
    advice.push_back(text.str());
  }
  return advice;
}

std::optional<std::string> CalibratedFocalAdvice(
    double focal_length_stddev_ratio,
    const CameraMap& given,
    const colmap::Reconstruction& model) {
  std::set<colmap::camera_t> camera_ids;
  for (const colmap::image_t image_id : SortedRegisteredImages(model)) {
    camera_ids.insert(model.Image(image_id).CameraId());
  }
  std::vector<colmap::camera_t> moved;
  for (const colmap::camera_t camera_id : camera_ids) {
    const auto camera = given.find(camera_id);
    if (camera == given.end() || !camera->second.HasPriorFocalLength()) {
      continue;
    }
    const double ratio = model.Camera(camera_id).MeanFocalLength() /
                         camera->second.MeanFocalLength();
    if (std::abs(ratio - 1) > kMaxFocalDeviation * focal_length_stddev_ratio) {
      moved.push_back(camera_id);
    }
  }
  if (moved.empty()) return std::nullopt;
  std::ostringstream text;
  text.precision(4);
  text << "The calibrated focal length of " << CountCameras(moved)
       << " contradicts its images: "
       << given.at(moved.front()).MeanFocalLength()
       << " px were given, the model has "
       << model.Camera(moved.front()).MeanFocalLength()
       << " px. Check that the calibration belongs to the images, or have it "
          "estimated (--intrinsics_prior exif)";
  return text.str();
}

}  // namespace dgsfm
