#include "controllers/depth_importer.h"

#include "colmap_ext/check.h"
#include "colmap_ext/depth_database.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/scene_database.h"
#include "controllers/command_options.h"
#include "controllers/commands.h"
#include "controllers/progress.h"

#include <algorithm>
#include <exception>
#include <filesystem>
#include <iomanip>
#include <iostream>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

// Maps in memory at a time, per thread: enough to keep threads busy while one
// of them is slow.
constexpr size_t kBatchSizePerThread = 4;

// Depth files by what an image with that depth may be called; names relative
// to the folder, with '/'.
std::map<std::string, std::vector<std::string>> FindDepthFiles(
    const std::string& depth_path) {
  if (!fs::is_directory(depth_path)) {
    throw std::runtime_error("depth folder " + depth_path + " does not exist");
  }
  const std::vector<std::string>& extensions = DepthFileExtensions();
  std::map<std::string, std::vector<std::string>> files;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(
           depth_path, fs::directory_options::follow_directory_symlink)) {
    const fs::path file = entry.path().lexically_relative(depth_path);
    if (!entry.is_regular_file() ||
        std::find(extensions.begin(), extensions.end(), file.extension()) ==
            extensions.end()) {
      continue;
    }
    files[fs::path(file).replace_extension().generic_string()].push_back(
        file.generic_string());
  }
  for (auto& [name, same_name_files] : files) {
    std::sort(same_name_files.begin(), same_name_files.end());
  }
  return files;
}

// The file of each image that has one.
std::map<colmap::image_t, std::string> MatchFilesToImages(
    const Scene& scene,
    const std::map<std::string, std::vector<std::string>>& files) {
  std::map<colmap::image_t, std::string> file_of_image;
  std::map<std::string, std::string> image_of_file;
  for (const auto& [image_id, image] : scene.images) {
    const std::string& name = image.Name();
    const std::string stem =
        fs::path(name).replace_extension().generic_string();
    std::vector<std::string> matches;
    for (const std::string& key : std::set<std::string>{name, stem}) {
      const auto match = files.find(key);
      if (match == files.end()) continue;
      matches.insert(matches.end(), match->second.begin(), match->second.end());
    }
    if (matches.empty()) continue;
    if (matches.size() > 1) {
      throw std::runtime_error("image " + name + " has two depth maps, " +
                               matches[0] + " and " + matches[1]);
    }
    const auto [other, is_new] = image_of_file.emplace(matches[0], name);
    if (!is_new) {
      throw std::runtime_error("depth map " + matches[0] +
                               " fits two images, " + other->second + " and " +
                               name);
    }
    file_of_image.emplace(image_id, matches[0]);
  }
  return file_of_image;
}

// What is stored and told of an image, or why it cannot be.
struct ImageDepth {
  CompressedDepthMap depth_map;
  KeypointDepths keypoint_depths;
  DepthImportSummary::Image summary;
  std::exception_ptr error;
};

ImageDepth ReadImageDepth(const std::string& depth_path,
                          const std::string& file,
                          const colmap::Image& image,
                          const colmap::Camera& camera,
                          const DepthImportOptions& options) {
  const std::string path = (fs::path(depth_path) / file).string();
  const DepthMap depth_map = ReadDepthMap(path, camera, options.reading);
  std::vector<Eigen::Vector2d> keypoints;
  keypoints.reserve(image.NumPoints2D());
  for (const colmap::Point2D& point2D : image.Points2D()) {
    keypoints.push_back(point2D.XY());
  }
  std::vector<float> depths = SampleDepth(
      depth_map, keypoints, camera.Width(), camera.Height(), options.sampling);

  ImageDepth result;
  result.summary.name = image.Name();
  result.summary.file = file;
  result.summary.width = depth_map.width;
  result.summary.height = depth_map.height;
  result.summary.coverage = depth_map.Coverage();
  result.summary.num_keypoints = depths.size();
  result.summary.num_keypoints_with_depth = std::count_if(
      depths.begin(), depths.end(), [](float depth) { return depth > 0; });
  result.depth_map = CompressDepth(depth_map);
  result.keypoint_depths = {options.reading.unit,
                            std::move(depths),
                            ReadDepthFocalLength(path, depth_map, camera)};
  result.summary.focal_length_px = result.keypoint_depths.focal_length_px;
  return result;
}

// Reads, samples and compresses in parallel, writes in the order of image ids.
std::vector<DepthImportSummary::Image> ImportFiles(
    const Scene& scene,
    const std::map<colmap::image_t, std::string>& file_of_image,
    const std::string& depth_path,
    const DepthImportOptions& options,
    DepthDatabase* database) {
  const std::vector<std::pair<colmap::image_t, std::string>> files(
      file_of_image.begin(), file_of_image.end());
  const size_t batch_size =
      kBatchSizePerThread * EffectiveNumThreads(options.num_threads);
  std::vector<DepthImportSummary::Image> imported;
  Progress progress("Importing depth maps", files.size());
  for (size_t begin = 0; begin < files.size(); begin += batch_size) {
    std::vector<ImageDepth> batch(std::min(batch_size, files.size() - begin));
    ParallelFor(batch.size(), options.num_threads, [&](size_t i) {
      const auto& [image_id, file] = files[begin + i];
      const colmap::Image& image = scene.images.at(image_id);
      try {
        batch[i] = ReadImageDepth(depth_path,
                                  file,
                                  image,
                                  scene.cameras.at(image.CameraId()),
                                  options);
      } catch (...) {
        // The first image's error is to be reported, not the first thread's.
        batch[i].error = std::current_exception();
      }
      progress.Step();
    });
    for (size_t i = 0; i < batch.size(); ++i) {
      if (batch[i].error) std::rethrow_exception(batch[i].error);
      database->WriteCompressedDepthMap(
          files[begin + i].first, batch[i].depth_map, batch[i].keypoint_depths);
      imported.push_back(std::move(batch[i].summary));
    }
  }
  return imported;
}

double Percentage(size_t part, size_t whole) {
  return whole == 0 ? 0 : 100.0 * part / whole;
}

template <typename T>
bool ParseChoice(const std::string& name,
                 const std::string& text,
                 const std::vector<std::pair<std::string, T>>& choices,
                 T* value) {
  std::string expected;
  for (const auto& [choice, choice_value] : choices) {
    if (text == choice) {
      *value = choice_value;
      return true;
    }
    expected += (expected.empty() ? "" : ", ") + choice;
  }
  std::cerr << "ERROR: " << name << " is '" << text << "' but must be one of "
            << expected << std::endl;
  return false;
}

}  // namespace

bool DepthImportOptions::IsValid(std::string* error) const {
  return reading.IsValid(error) && sampling.IsValid(error);
}

std::string DepthImportSummary::ToText() const {
  std::ostringstream text;
  text << std::fixed << std::setprecision(1);
  size_t num_keypoints = 0;
  size_t num_keypoints_with_depth = 0;
  for (const Image& image : imported) {
    text << image.name << ": " << image.width << " x " << image.height
         << " map, " << 100 * image.coverage << " % known, "
         << image.num_keypoints_with_depth << " of " << image.num_keypoints
         << " key points with depth ("
         << Percentage(image.num_keypoints_with_depth, image.num_keypoints)
         << " %)";
    if (image.focal_length_px > 0) {
      text << ", focal length " << image.focal_length_px << " px";
    }
    text << "\n";
    num_keypoints += image.num_keypoints;
    num_keypoints_with_depth += image.num_keypoints_with_depth;
  }
  for (const std::string& file : files_without_image) {
    text << "file without image: " << file << "\n";
  }
  for (const std::string& name : images_without_depth) {
    text << "image without depth: " << name << "\n";
  }
  if (num_kept > 0) {
    text << num_kept << " of these keep the depth of an earlier import\n";
  }
  text << "imported " << imported.size() << " of "
       << imported.size() + images_without_depth.size() << " images, "
       << num_keypoints_with_depth << " key points with depth ("
       << Percentage(num_keypoints_with_depth, num_keypoints) << " %)\n";
  return text.str();
}

DepthImportSummary ImportDepthMaps(const std::string& database_path,
                                   const std::string& depth_path,
                                   const DepthImportOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const Scene scene = ReadSceneWithoutMatches(database_path);
  const auto files = FindDepthFiles(depth_path);
  const auto file_of_image = MatchFilesToImages(scene, files);
  if (file_of_image.empty()) {
    throw std::runtime_error(
        "no depth map in " + depth_path + " is named after one of the " +
        std::to_string(scene.images.size()) + " images of " + database_path);
  }

  DepthDatabase database(database_path, DepthDatabase::Mode::READ_WRITE);
  database.BeginTransaction();
  DepthImportSummary summary;
  summary.imported =
      ImportFiles(scene, file_of_image, depth_path, options, &database);
  database.DeleteAllPairGeometries();
  database.CommitTransaction();

  std::set<std::string> used_files;
  for (const auto& [image_id, file] : file_of_image) used_files.insert(file);
  for (const auto& [image_name, same_name_files] : files) {
    for (const std::string& file : same_name_files) {
      if (used_files.count(file) == 0) {
        summary.files_without_image.push_back(file);
      }
    }
  }
  for (const auto& [image_id, image] : scene.images) {
    if (file_of_image.count(image_id) > 0) continue;
    summary.images_without_depth.push_back(image.Name());
    if (database.HasDepthMap(image_id)) ++summary.num_kept;
  }
  return summary;
}

int RunDepthImporter(int argc, char** argv) {
  std::string database_path;
  std::string depth_path;
  std::string depth_type = "z";
  std::string depth_unit = "metric";
  DepthImportOptions options;
  CommandOptions command("depth_importer",
                         "Stores depth maps and their values at the key points "
                         "in the database.");
  command.AddRequired("database_path", &database_path, "COLMAP database");
  command.AddRequired("depth_path",
                      &depth_path,
                      "Folder of depth maps named after the images, a.jpg.npy "
                      "or a.npy; also .npz, .pfm and .png");
  command.Add("depth_type",
              &depth_type,
              "What the numbers are: z (third coordinate), range (length of "
              "the ray) or inverse (1 / z)");
  command.Add("depth_scale",
              &options.reading.scale,
              "Depth per unit of the files, e.g. 0.001 for millimetres; for "
              "inverse, depth times number");
  command.Add("depth_unit",
              &depth_unit,
              "What depth is measured in after scaling: metric (metres) or "
              "relative (unknown)");
  command.Add("DepthSampling.max_neighbor_ratio",
              &options.sampling.max_neighbor_ratio,
              "Largest ratio of neighbouring depths on one surface [1]");
  command.Add("DepthSampling.keep_edges",
              &options.sampling.keep_edges,
              "Whether key points on depth edges get the nearest depth");
  command.Add("num_threads",
              &options.num_threads,
              "Threads that read and sample; -1 for one per core");
  if (const auto exit_code = command.Parse(argc, argv)) return *exit_code;
  std::string error;
  if (!ParseChoice<DepthType>("depth_type",
                              depth_type,
                              {{"z", DepthType::Z},
                               {"range", DepthType::RANGE},
                               {"inverse", DepthType::INVERSE}},
                              &options.reading.type) ||
      !ParseChoice<DepthUnit>(
          "depth_unit",
          depth_unit,
          {{"metric", DepthUnit::METRIC}, {"relative", DepthUnit::RELATIVE}},
          &options.reading.unit)) {
    return 2;
  }
  if (!options.IsValid(&error)) {
    std::cerr << "ERROR: " << error << std::endl;
    return 2;
  }
  std::cout << ImportDepthMaps(database_path, depth_path, options).ToText()
            << std::flush;
  return 0;
}

}  // namespace dgsfm
