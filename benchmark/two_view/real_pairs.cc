// Accuracy of the two-view estimator on the image pairs of COLMAP databases
// with ground truth. Prints a Markdown table, a row per set and one for the
// pairs of all of them.
//
//   real_pairs [two | shared | known] [paper] [complete] DEPTH SET...
//
// Focal lengths are two unknown ones (the default), one unknown one for both
// images, or the true ones. "paper" takes the published estimator, "complete"
// the pairs alone whose images both have a depth map.
//
// SET holds database.db, gt/ (a text model, and pairs.txt with "name1 name2
// inliers share" per verified pair) and a folder for each DEPTH ("none":
// without depth) with one <image name>.npy per image. Pairs with a share above
// 0.7 are the true ones, and only those count.

#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/model/model_io.h"

#include <filesystem>
#include <fstream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "benchmark/two_view/pair_statistics.h"

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

struct Settings {
  FocalCase focal_case = FocalCase::TWO;
  bool complete_only = false;
  TwoViewDepthOptions estimator;
};

struct ImageSet {
  Scene scene;
  std::map<std::string, colmap::image_t> image_ids;
  std::map<std::string, ModelImage> truth;
  std::map<colmap::camera_t, colmap::Camera> true_cameras;
  std::vector<std::pair<std::string, std::string>> pairs;
};

ImageSet ReadImageSet(const fs::path& folder) {
  constexpr double kMinShare = 0.7;
  ImageSet set;
  set.scene = ReadScene((folder / "database.db").string());
  for (const auto& [image_id, image] : set.scene.images) {
    set.image_ids[image.Name()] = image_id;
  }
  set.truth = ReadModelImages((folder / "gt").string());
  set.true_cameras = ReadModelCameras((folder / "gt").string());
  std::ifstream file(folder / "gt" / "pairs.txt");
  if (!file)
    throw std::runtime_error("no " + folder.string() + "/gt/pairs.txt");
  std::string line;
  while (std::getline(file, line)) {
    std::istringstream fields(line);
    std::string name1, name2;
    int num_inliers;
    double share;
    if (line[0] == '#' || !(fields >> name1 >> name2 >> num_inliers >> share)) {
      continue;
    }
    if (share > kMinShare) set.pairs.emplace_back(name1, name2);
  }
  return set;
}

// Depth at the key points of every image that has a file.
std::map<colmap::image_t, std::vector<float>> ReadDepths(
    const ImageSet& set, const fs::path& folder) {
  std::map<colmap::image_t, std::vector<float>> depths;
  for (const auto& [image_id, image] : set.scene.images) {
    const fs::path path = folder / (image.Name() + ".npy");
    if (!fs::exists(path)) continue;
    const colmap::Camera& camera = set.scene.cameras.at(image.CameraId());
    std::vector<Eigen::Vector2d> points;
    for (const colmap::Point2D& point : image.Points2D()) {
      points.push_back(point.XY());
    }
    depths[image_id] = SampleDepth(ReadDepthMap(path.string(), camera, {}),
                                   points,
                                   static_cast<int>(camera.Width()),
                                   static_cast<int>(camera.Height()),
                                   {});
  }
  return depths;
}

TwoViewDepthInput CreateInput(
    const ImageSet& set,
    const std::map<colmap::image_t, std::vector<float>>& depths,
    colmap::image_t image_id1,
    colmap::image_t image_id2) {
  TwoViewDepthInput input;
  const auto collect = [&](colmap::image_t image_id,
                           bool first,
                           std::vector<Eigen::Vector2d>* points,
                           std::vector<double>* point_depths) {
    const colmap::Image& image = set.scene.images.at(image_id);
    const colmap::Camera& camera = set.scene.cameras.at(image.CameraId());
    const Eigen::Vector2d center(camera.PrincipalPointX(),
                                 camera.PrincipalPointY());
    const auto known = depths.find(image_id);
    for (const colmap::FeatureMatch& match :
         set.scene.matches.at(PairIdOfImages(image_id1, image_id2))) {
      const colmap::point2D_t idx =
          first ? match.point2D_idx1 : match.point2D_idx2;
      points->push_back(image.Point2D(idx).XY() - center);
      point_depths->push_back(known == depths.end() ? 0 : known->second[idx]);
    }
    (first ? input.focal_length1_px : input.focal_length2_px) =
        camera.MeanFocalLength();
    (first ? input.image_size1_px : input.image_size2_px) =
        static_cast<double>(std::max(camera.Width(), camera.Height()));
  };
  DepthMatches& matches = input.matches;
  collect(image_id1, true, &matches.points1, &matches.depths1);
  collect(image_id2, false, &matches.points2, &matches.depths2);
  input.seed = PairIdOfImages(image_id1, image_id2);
  return input;
}

TwoViewModel Truth(const ImageSet& set,
                   const std::string& name1,
                   const std::string& name2) {
  const ModelImage& image1 = set.truth.at(name1);
  const ModelImage& image2 = set.truth.at(name2);
  const Rigid3d cam2_from_cam1 =
      image2.cam_from_world * image1.cam_from_world.Inverse();
  TwoViewModel truth;
  truth.rotation = cam2_from_cam1.rotation.toRotationMatrix();
  truth.translation = cam2_from_cam1.translation;
  truth.focal1 = set.true_cameras.at(image1.camera_id).MeanFocalLength();
  truth.focal2 = set.true_cameras.at(image2.camera_id).MeanFocalLength();
  return truth;
}

void Run(const fs::path& folder,
         const std::string& depth_name,
         const Settings& settings,
         PairStatistics* all) {
  const ImageSet set = ReadImageSet(folder);
  const auto depths = ReadDepths(set, folder / depth_name);
  PairStatistics statistics;
  int num_pairs = 0;
  for (auto [name1, name2] : set.pairs) {
    if (set.image_ids.at(name1) > set.image_ids.at(name2)) {
      std::swap(name1, name2);
    }
    const colmap::image_t image_id1 = set.image_ids.at(name1);
    const colmap::image_t image_id2 = set.image_ids.at(name2);
    if (settings.complete_only &&
        (depths.count(image_id1) == 0 || depths.count(image_id2) == 0)) {
      continue;
    }
    ++num_pairs;
    const TwoViewModel truth = Truth(set, name1, name2);
    TwoViewDepthInput input = CreateInput(set, depths, image_id1, image_id2);
    input.focal_case = settings.focal_case;
    if (settings.focal_case == FocalCase::KNOWN) {
      input.focal_length1_px = truth.focal1;
      input.focal_length2_px = truth.focal2;
    }
    double milliseconds;
    const TwoViewDepthResult result =
        EstimateTimed(input, settings.estimator, &milliseconds);
    for (PairStatistics* to : {&statistics, all}) {
      to->Add(result, truth, /*scale_is_known=*/false, milliseconds);
    }
  }
  statistics.Print(folder.filename().string() + ", " + depth_name + ", " +
                   std::to_string(num_pairs) + " pairs");
}

}  // namespace
}  // namespace dgsfm

int main(int argc, char** argv) {
  dgsfm::Settings settings;
  std::vector<std::string> arguments(argv + 1, argv + argc);
  const auto take = [&arguments](const std::string& name) {
    const bool found = !arguments.empty() && arguments.front() == name;
    if (found) arguments.erase(arguments.begin());
    return found;
  };
  if (take("shared")) {
    settings.focal_case = dgsfm::FocalCase::SHARED;
  } else if (take("known")) {
    settings.focal_case = dgsfm::FocalCase::KNOWN;
  } else {
    take("two");
  }
  settings.estimator.paper = take("paper");
  settings.complete_only = take("complete");
  if (arguments.size() < 2) {
    std::fprintf(stderr,
                 "usage: real_pairs [two | shared | known] [paper] [complete] "
                 "DEPTH SET...\n");
    return 2;
  }
  try {
    dgsfm::PairStatistics::PrintHeader("set");
    dgsfm::PairStatistics all;
    for (size_t i = 1; i < arguments.size(); ++i) {
      dgsfm::Run(arguments[i], arguments[0], settings, &all);
    }
    all.Print("all, " + arguments[0]);
  } catch (const std::exception& e) {
    std::fprintf(stderr, "ERROR: %s\n", e.what());
    return 1;
  }
  return 0;
}
