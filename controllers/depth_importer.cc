#include "controllers/depth_importer.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/affine_depth.h"
#include "colmap_ext/depth/image_orientation.h"
#include "colmap_ext/fnv_hash.h"
#include "colmap_ext/output_file.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/progress.h"
#include "controllers/depth_file_search.h"
#include "estimators/median.h"

#include <algorithm>
#include <filesystem>
#include <iomanip>
#include <map>
#include <mutex>
#include <set>
#include <sstream>
#include <stdexcept>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

// Maps in memory at a time, per thread: enough to keep threads busy while one
// of them is slow.
constexpr size_t kBatchSizePerThread = 4;

// What is stored and reported for an image, or why it cannot be.
struct ImageDepth {
  CompressedDepthMap depth_map;
  KeypointDepths keypoint_depths;
  DepthImportSummary::Image summary;
  std::string error;
};

void AddFile(const std::string& path, FnvHash* hash) {
  hash->AddAll(fs::path(path).filename().string());
  std::error_code error;
  hash->Add(path.empty() ? uintmax_t{0} : fs::file_size(path, error));
  hash->Add(
      path.empty()
          ? int64_t{0}
          : int64_t{
                fs::last_write_time(path, error).time_since_epoch().count()});
}

void AddArrays(const ArrayReader& arrays, FnvHash* hash) try {
  for (const char* name : kDepthArrayNames) {
    const auto array = arrays(name);
    hash->Add(array.has_value());
    if (!array) continue;
    hash->AddAll(array->shape);
    hash->AddAll(array->values);
  }
} catch (const std::runtime_error&) {
  // The import of the image fails with the reason.
}

// Hash of all that the depth of an image depends on, its key points excepted.
uint64_t SourceFingerprint(const DepthFile& file,
                           const colmap::Camera& camera,
                           const DepthImportOptions& options) {
  FnvHash hash;
  if (file.arrays) {
    AddArrays(file.arrays, &hash);
  } else {
    AddFile(file.path, &hash);
  }
  hash.AddAll(file.group);
  AddFile(file.confidence_path, &hash);
  hash.Add(file.orientation);
  hash.Add(static_cast<int>(options.reading.type));
  hash.Add(options.reading.scale);
  hash.Add(static_cast<int>(options.reading.unit));
  hash.Add(options.reading.max_depth);
  hash.Add(options.reading.min_confidence);
  hash.Add(options.reading.min_relative_confidence);
  hash.Add(options.reading.max_uncertainty);
  hash.Add(options.sampling.max_neighbor_ratio);
  hash.Add(options.sampling.keep_edges);
  hash.Add(options.keypoints_only);
  hash.Add(camera.ModelId());
  hash.Add(camera.Width());
  hash.Add(camera.Height());
  hash.AddAll(camera.Params());
  return hash.Value();
}

// Depths beyond what is stored would come out flat, and such units leave models
// that lose digits.
void CheckIsStorable(const DepthMapStatistics& statistics) {
  if (statistics.max == 0 || (statistics.median >= kMinStorableDepth &&
                              statistics.median <= kMaxStorableDepth)) {
    return;
  }
  std::ostringstream text;
  text << std::setprecision(3) << "its median depth is " << statistics.median
       << ", and depths are stored from " << kMinStorableDepth << " to "
       << std::setprecision(5) << kMaxStorableDepth
       << ": give another --depth_scale";
  throw std::runtime_error(text.str());
}

ImageDepth ReadImageDepth(const DepthFile& file,
                          const std::vector<Eigen::Vector2d>& keypoints,
                          const colmap::Camera& camera,
                          const DepthImportOptions& options) {
  const ImportedDepth imported = ReadDepth(file, camera, options.reading);
  const DepthMap& depth_map = imported.depth_map;
  const bool is_affine = IsAffine(depth_map.unit);
  const auto width = static_cast<int>(camera.Width());
  const auto height = static_cast<int>(camera.Height());
  const DepthSamplingOptions& sampling = options.sampling;
  std::vector<float> depths =
      is_affine ? SampleAffine(
                      depth_map, keypoints, width, height, sampling.keep_edges)
                : SampleDepth(depth_map, keypoints, width, height, sampling);

  ImageDepth result;
  result.summary.file = file.Description();
  result.summary.width = depth_map.width;
  result.summary.height = depth_map.height;
  result.summary.coverage = imported.coverage;
  result.summary.num_keypoints = depths.size();
  std::vector<double> known_depths;
  for (const float depth : depths) {
    if (depth != 0) known_depths.push_back(depth);
  }
  result.summary.num_keypoints_with_depth = known_depths.size();
  if (!known_depths.empty()) {
    result.summary.median_depth = Median(std::move(known_depths));
  }
  const DepthMapStatistics statistics = MeasureDepthMap(depth_map);
  if (!is_affine) CheckIsStorable(statistics);
  result.summary.oddities = FindOddities(statistics, options.reading);
  result.summary.lower_to_upper = statistics.lower_to_upper;
  result.summary.focal_length_px = imported.focal_length_px;
  result.summary.is_stretched = imported.is_stretched;
  result.summary.is_relative = is_affine;
  if (!options.keypoints_only) {
    result.depth_map =
        CompressDepth(is_affine ? StorableAffine(depth_map) : depth_map);
  }
  result.keypoint_depths = {depth_map.unit,
                            std::move(depths),
                            imported.focal_length_px,
                            SourceFingerprint(file, camera, options)};
  return result;
}

// Reads, samples and compresses in parallel, writes in the order of image ids.
class FileImport {
 public:
  FileImport(const Scene& scene,
             const DepthImportOptions& options,
             const std::string& database_path,
             DepthDatabase* database)
      : scene_(scene),
        options_(options),
        connection_(database_path, SqliteConnection::Mode::READ_ONLY),
        database_(database),
        displayed_images_(database->ReadDisplayedImages()) {}

  void Run(const std::vector<std::pair<colmap::image_t, DepthFile>>& files,
           DepthImportSummary* summary) {
    const size_t batch_size =
        kBatchSizePerThread * EffectiveNumThreads(options_.num_threads);
    Progress progress("Importing depth maps", files.size());
    for (size_t begin = 0; begin < files.size(); begin += batch_size) {
      std::vector<ImageDepth> batch(std::min(batch_size, files.size() - begin));
      ParallelFor(batch.size(), options_.num_threads, [&](size_t i) {
        batch[i] = Read(files[begin + i].first, files[begin + i].second);
        progress.Step();
      });
      Write(files.begin() + begin, &batch, summary);
    }
  }

 private:
  ImageDepth Read(colmap::image_t image_id, const DepthFile& file) {
    const colmap::Image& image = scene_.images.at(image_id);
    ImageDepth result;
    try {
      const std::vector<Eigen::Vector2d> keypoints = ReadKeypoints(image);
      result = ReadImageDepth(
          file, keypoints, scene_.cameras.at(image.CameraId()), options_);
    } catch (const std::runtime_error& error) {
      result.error = error.what();
    }
    result.summary.name = image.Name();
    return result;
  }

  // Connections serve one thread at a time.
  std::vector<Eigen::Vector2d> ReadKeypoints(const colmap::Image& image) {
    const std::lock_guard<std::mutex> lock(connection_mutex_);
    return dgsfm::ReadKeypoints(connection_, image);
  }

  void Write(
      std::vector<std::pair<colmap::image_t, DepthFile>>::const_iterator file,
      std::vector<ImageDepth>* batch,
      DepthImportSummary* summary) {
    const bool is_any_read =
        std::any_of(batch->begin(), batch->end(), [](const ImageDepth& image) {
          return image.error.empty();
        });
    if (is_any_read) {
      database_->BeginTransaction();
      database_->DeleteAllPairGeometries();
    }
    const bool is_displayed = !options_.displayed_image_path.empty();
    for (ImageDepth& image : *batch) {
      const colmap::image_t image_id = (file++)->first;
      if (!image.error.empty()) {
        summary->failed.push_back({image.summary.name, image.error});
        continue;
      }
      if (options_.keypoints_only) {
        database_->WriteKeypointDepths(image_id, image.keypoint_depths);
      } else {
        database_->WriteCompressedDepthMap(
            image_id, image.depth_map, image.keypoint_depths);
      }
      if (is_displayed || displayed_images_.count(image_id) > 0) {
        database_->WriteIsDisplayed(image_id, is_displayed);
      }
      summary->imported.push_back(std::move(image.summary));
    }
    if (is_any_read) database_->CommitTransaction();
  }

  const Scene& scene_;
  const DepthImportOptions& options_;
  std::mutex connection_mutex_;
  const SqliteConnection connection_;
  DepthDatabase* database_;
  // Images marked by an earlier import.
  const std::set<colmap::image_t> displayed_images_;
};

// Gives each file the orientation of its image.
void ReadOrientations(const Scene& scene,
                      const std::string& image_path,
                      std::map<colmap::image_t, DepthFile>* file_of_image) {
  for (auto& [image_id, file] : *file_of_image) {
    file.orientation = ReadExifOrientation(
        PathInside(image_path, scene.images.at(image_id).Name()));
  }
}

double Percentage(size_t part, size_t whole) {
  return whole == 0 ? 0 : 100.0 * part / whole;
}

DepthImportSummary Import(const Scene& scene,
                          const std::string& database_path,
                          DepthFileSearch search,
                          const DepthImportOptions& options) {
  if (!options.displayed_image_path.empty()) {
    ReadOrientations(
        scene, options.displayed_image_path, &search.file_of_image);
  }
  DepthDatabase database(database_path, DepthDatabase::Mode::READ_WRITE);
  const auto known = database.ReadSourceFingerprints();
  DepthImportSummary summary;
  summary.type = options.reading.type;
  summary.files_without_image = std::move(search.files_without_image);
  std::vector<std::pair<colmap::image_t, DepthFile>> files;
  for (const auto& [image_id, image] : scene.images) {
    const auto file = search.file_of_image.find(image_id);
    const auto known_fingerprint = known.find(image_id);
    if (file == search.file_of_image.end()) {
      summary.images_without_depth.push_back(image.Name());
      if (known_fingerprint != known.end()) ++summary.num_kept;
    } else if (!options.overwrite && known_fingerprint != known.end() &&
               known_fingerprint->second ==
                   SourceFingerprint(file->second,
                                     scene.cameras.at(image.CameraId()),
                                     options)) {
      ++summary.num_unchanged;
    } else {
      files.emplace_back(*file);
    }
  }
  FileImport(scene, options, database_path, &database).Run(files, &summary);
  return summary;
}

}  // namespace

bool DepthImportOptions::IsValid(std::string* error) const {
  return reading.IsValid(error) && sampling.IsValid(error);
}

std::string DepthImportSummary::FailureText() const {
  return std::to_string(failed.size()) +
         " depth maps could not be imported, the first: " +
         failed.front().reason;
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
    if (image.num_keypoints_with_depth > 0) {
      // Whoever forgot depth_scale sees it here.
      text << (image.is_relative ? ", median value " : ", median depth ")
           << std::defaultfloat << std::setprecision(3) << image.median_depth
           << std::fixed << std::setprecision(1);
    }
    if (image.focal_length_px > 0) {
      text << ", focal length " << image.focal_length_px << " px";
    }
    if (image.is_stretched) text << ", stretched to the image's aspect";
    text << "\n";
    num_keypoints += image.num_keypoints;
    num_keypoints_with_depth += image.num_keypoints_with_depth;
  }
  for (const Failure& failure : failed) {
    text << "failed: " << failure.name << ": " << failure.reason << "\n";
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
  if (num_unchanged > 0) {
    text << num_unchanged
         << " images were imported from the same files before "
            "(--overwrite 1 imports them again)\n";
  }
  std::vector<DepthKindSample> samples;
  for (const Image& image : imported) {
    samples.push_back({image.name, image.oddities, image.lower_to_upper});
  }
  const size_t num_images = imported.size() + failed.size() + num_unchanged +
                            images_without_depth.size();
  text << DepthKindWarnings(samples, type)
       << MissingMapsWarning(images_without_depth.size() - num_kept, num_images)
       << "imported " << imported.size() << " of " << num_images << " images, "
       << num_keypoints_with_depth << " key points with depth ("
       << Percentage(num_keypoints_with_depth, num_keypoints) << " %)\n";
  return text.str();
}

DepthImportSummary ImportDepthMaps(const std::string& database_path,
                                   const std::string& depth_path,
                                   const DepthImportOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const Scene scene = ReadScene(database_path, SceneContent::IMAGES);
  DepthFileSearch search =
      FindDepthFiles(scene, depth_path, options.confidence_path);
  if (search.file_of_image.empty()) {
    throw std::runtime_error(
        "no depth map in " + depth_path + " is named after one of the " +
        std::to_string(scene.images.size()) + " images of " + database_path);
  }
  return Import(scene, database_path, std::move(search), options);
}

DepthImportSummary ImportDepthMaps(
    const std::string& database_path,
    const std::map<std::string, DepthFile>& depth_of_image,
    const DepthImportOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const Scene scene = ReadScene(database_path, SceneContent::IMAGES);
  if (!options.confidence_path.empty()) {
    throw std::runtime_error(
        "confidence_path goes with a folder of depth maps, not with maps by "
        "the names of images");
  }
  DepthFileSearch search;
  std::map<std::string, colmap::image_t> image_ids;
  for (const auto& [image_id, image] : scene.images) {
    image_ids[image.Name()] = image_id;
  }
  for (const auto& [name, file] : depth_of_image) {
    const auto image_id = image_ids.find(name);
    if (image_id == image_ids.end()) {
      search.files_without_image.push_back(name);
    } else {
      search.file_of_image[image_id->second] = file;
    }
  }
  if (search.file_of_image.empty()) {
    throw std::runtime_error(
        "none of the " + std::to_string(depth_of_image.size()) +
        " depth maps has the name of one of the " +
        std::to_string(scene.images.size()) + " images of " + database_path);
  }
  return Import(scene, database_path, std::move(search), options);
}

}  // namespace dgsfm
