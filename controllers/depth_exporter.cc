#include "controllers/depth_exporter.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/affine_depth.h"
#include "colmap_ext/depth/depth_map_io.h"
#include "colmap_ext/depth/depth_undistortion.h"
#include "colmap_ext/output_file.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/progress.h"
#include "controllers/dense_workspace.h"
#include "controllers/output_folder.h"
#include "controllers/sparse_model.h"
#include "controllers/splatting_depth.h"
#include "estimators/median.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <iomanip>
#include <map>
#include <sstream>
#include <stdexcept>

#include <nlohmann/json.hpp>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

// Share of the inverse depths of all images that the range covers; nearer ones
// saturate.
constexpr double kInverseDepthQuantile = 0.999;

// Values that the alignment takes out of range become unknown.
void ApplyAlignment(const DepthAlignment& alignment, DepthMap* depth_map) {
  size_t i = 0;
  for (int y = 0; y < depth_map->height; ++y) {
    for (int x = 0; x < depth_map->width; ++x, ++i) {
      float& depth = depth_map->values[i];
      if (depth <= 0) continue;
      depth = static_cast<float>(alignment.Apply(
          (x + 0.5) / depth_map->width, (y + 0.5) / depth_map->height, depth));
      if (!std::isfinite(depth)) depth = 0;
    }
  }
}

std::string FileName(const std::string& image_name, DepthExportFormat format) {
  static const std::map<DepthExportFormat, std::string> kExtensions = {
      {DepthExportFormat::NPY, ".npy"},
      {DepthExportFormat::PNG, ".png"},
      {DepthExportFormat::EXR, ".exr"},
      {DepthExportFormat::DENSE_BIN, ".geometric.bin"}};
  if (format == DepthExportFormat::COLMAP_WORKSPACE) {
    return WorkspaceDepthFile(image_name);
  }
  const auto extension = kExtensions.find(format);
  return extension == kExtensions.end() ? SplattingFileName(image_name)
                                        : image_name + extension->second;
}

// An image to be exported, all that is decided before its map is read again.
struct Job {
  colmap::image_t image_id = colmap::kInvalidImageId;
  std::string name;
  // In the models, where there are any.
  const colmap::Camera* camera = nullptr;
  const colmap::Camera* undistorted_camera = nullptr;
  std::optional<DepthAlignment> alignment;
  bool has_few_points = false;
  double near_inverse_depth = 0;  // the quantile of the image
};

class Exporter {
 public:
  Exporter(const std::string& database_path,
           const std::optional<std::string>& model_path,
           const std::string& output_path,
           const DepthExportOptions& options)
      : database_path_(database_path),
        output_path_(output_path),
        options_(options) {
    if (model_path) model_ = ReadSparseModel(*model_path);
    if (options.format == DepthExportFormat::COLMAP_WORKSPACE) {
      undistorted_model_ = ReadSparseModel(WorkspaceModelPath(output_path));
    } else if (!options.undistorted_path.empty()) {
      undistorted_model_ = ReadSparseModel(options.undistorted_path);
    }
  }

  DepthExportSummary Run() {
    std::vector<Job> jobs = FindJobs();
    const bool is_for_splatting =
        options_.format == DepthExportFormat::GAUSSIAN_SPLATTING;
    SplattingScales scales;
    if (is_for_splatting) {
      scales = ImagesForSplatting(jobs);
      CheckSplattingNames(scales);
    }
    // Maps are read twice, as all of them together need not fit into memory.
    if (model_ || is_for_splatting) {
      ForEach("Aligning depth maps", &jobs, [&](Job* job, DepthMap map) {
        Prepare(job, std::move(map));
      });
    }
    const auto last =
        std::stable_partition(jobs.begin(), jobs.end(), [](const Job& job) {
          return !job.has_few_points;
        });
    for (auto job = last; job != jobs.end(); ++job) {
      summary_.images_with_few_points.push_back(job->name);
    }
    jobs.erase(last, jobs.end());
    double max_inverse_depth = 0;
    for (const Job& job : jobs) {
      max_inverse_depth = std::max(max_inverse_depth, job.near_inverse_depth);
    }
    // One scale for all images: see WriteSplattingParameters().
    splatting_scale_ = SplattingScale(max_inverse_depth);
    ForEach("Writing depth maps", &jobs, [&](Job* job, DepthMap map) {
      Write(*job, std::move(map));
    });
    for (Job& job : jobs) {
      scales[job.name] = splatting_scale_;
      summary_.exported.push_back({job.name,
                                   FileName(job.name, options_.format),
                                   std::move(job.alignment)});
    }
    if (is_for_splatting) WriteSplattingParameters(output_path_, scales);
    if (options_.format == DepthExportFormat::COLMAP_WORKSPACE) {
      WriteFusionList(output_path_, NamesOfExported());
    }
    if (model_) WriteAlignments();
    return std::move(summary_);
  }

 private:
  std::vector<Job> FindJobs() {
    const Scene scene = ReadScene(database_path_, SceneContent::IMAGES);
    const DepthDatabase database(database_path_,
                                 DepthDatabase::Mode::READ_ONLY);
    std::vector<Job> jobs;
    bool is_any_map = false;
    for (const auto& [image_id, image] : scene.images) {
      if (!database.HasDepthMap(image_id)) {
        summary_.images_without_map.push_back(image.Name());
        continue;
      }
      is_any_map = true;
      Job job = {image_id, image.Name()};
      if (model_) {
        if (model_->images.count(image.Name()) == 0) {
          summary_.images_without_model.push_back(image.Name());
          continue;
        }
        job.camera = &CameraOfImage(*model_, image.Name());
      }
      if (undistorted_model_) {
        job.undistorted_camera =
            &CameraOfImage(*undistorted_model_, image.Name());
      }
      jobs.push_back(std::move(job));
    }
    if (!is_any_map) {
      throw std::runtime_error(database_path_ +
                               " holds no depth map; run depth_importer "
                               "without --keypoints_only");
    }
    // Writing nothing would look like success.
    if (jobs.empty()) {
      throw std::runtime_error("no image of " + database_path_ +
                               " with a depth map is in the model");
    }
    return jobs;
  }

  // Each item opens the database for itself: connections are not shared by
  // threads.
  template <typename Function>
  void ForEach(const std::string& label,
               std::vector<Job>* jobs,
               const Function& function) const {
    Progress progress(label, jobs->size());
    ParallelFor(jobs->size(), options_.num_threads, [&](size_t i) {
      Job& job = (*jobs)[i];
      DepthMap map =
          DepthDatabase(database_path_, DepthDatabase::Mode::READ_ONLY)
              .ReadDepthMap(job.image_id);
      if (IsAffine(map.unit) && !model_) {
        throw std::runtime_error(
            "the map of image " + job.name +
            " is relative: it becomes depth by a model alone (--input_path)");
      }
      if (IsAffine(map.unit) && !ConvertByPoints(*model_, job.name, &map)) {
        job.has_few_points = true;
      } else {
        function(&job, std::move(map));
      }
      progress.Step();
    });
  }

  void Prepare(Job* job, DepthMap depth_map) const {
    if (model_) {
      job->alignment = AlignDepth(
          FindDepthCorrespondences(*model_, job->name, depth_map),
          static_cast<double>(job->camera->Width()) / job->camera->Height(),
          options_.alignment);
      job->has_few_points = !job->alignment.has_value();
      if (job->has_few_points) return;
      ApplyAlignment(*job->alignment, &depth_map);
    }
    std::vector<float> depths;
    for (const float depth : depth_map.values) {
      if (depth > 0) depths.push_back(depth);
    }
    if (depths.empty()) return;
    const auto near =
        depths.begin() +
        static_cast<size_t>((1 - kInverseDepthQuantile) * (depths.size() - 1));
    std::nth_element(depths.begin(), near, depths.end());
    job->near_inverse_depth = 1 / *near;
  }

  void Write(const Job& job, DepthMap depth_map) const {
    if (job.alignment) ApplyAlignment(*job.alignment, &depth_map);
    if (job.undistorted_camera != nullptr) {
      depth_map =
          UndistortDepth(depth_map, *job.camera, *job.undistorted_camera);
    }
    if (options_.format == DepthExportFormat::COLMAP_WORKSPACE) {
      WriteWorkspaceMaps(output_path_,
                         job.name,
                         std::move(depth_map),
                         *job.undistorted_camera);
      return;
    }
    const fs::path path =
        PathInside(output_path_, FileName(job.name, options_.format));
    // Images in sub-folders have their maps in the same ones.
    CreateOutputFolder(path.parent_path().string());
    WriteMap(path.string(), depth_map);
  }

  void WriteMap(const std::string& path, const DepthMap& depth_map) const {
    switch (options_.format) {
      case DepthExportFormat::NPY:
        WriteDepthNpy(path, depth_map, NpyPrecision::SINGLE);
        break;
      case DepthExportFormat::PNG:
        WriteDepthPng(path, depth_map, options_.png_scale);
        break;
      case DepthExportFormat::EXR:
        WriteDepthExr(path, depth_map);
        break;
      case DepthExportFormat::DENSE_BIN:
        WriteDepthDenseBin(path, depth_map);
        break;
      case DepthExportFormat::GAUSSIAN_SPLATTING:
        WriteSplattingPng(path, depth_map, splatting_scale_);
        break;
      case DepthExportFormat::COLMAP_WORKSPACE:
        break;  // No file alone.
    }
  }

  std::vector<std::string> NamesOfExported() const {
    std::vector<std::string> names;
    for (const DepthExportSummary::Image& image : summary_.exported) {
      names.push_back(image.name);
    }
    return names;
  }

  // The images of the model or, without one, of the database, without scales.
  SplattingScales ImagesForSplatting(const std::vector<Job>& jobs) const {
    SplattingScales scales;
    if (model_) {
      for (const auto& [name, image] : model_->images) scales[name] = 0;
      return scales;
    }
    for (const Job& job : jobs) scales[job.name] = 0;
    for (const std::string& name : summary_.images_without_map) {
      scales[name] = 0;
    }
    return scales;
  }

  void WriteAlignments() const {
    nlohmann::ordered_json json = nlohmann::ordered_json::object();
    for (const DepthExportSummary::Image& image : summary_.exported) {
      json[image.name] = {{"scale", image.alignment->scale},
                          {"shift", image.alignment->shift},
                          {"has_field", !image.alignment->field.empty()},
                          {"num_points", image.alignment->num_points},
                          {"scale_residual", image.alignment->scale_residual},
                          {"residual", image.alignment->residual}};
    }
    WriteFile((fs::path(output_path_) / "alignment.json").string(),
              JsonText(json, 2) + "\n");
  }

  const std::string database_path_;
  const std::string output_path_;
  const DepthExportOptions& options_;
  std::optional<SparseModel> model_;
  std::optional<SparseModel> undistorted_model_;
  // See SplattingScale.
  double splatting_scale_ = 0;
  DepthExportSummary summary_;
};

}  // namespace

bool DepthExportOptions::IsValid(std::string* error) const {
  if (!(png_scale > 0 && std::isfinite(png_scale))) {
    *error = "png_scale must be positive and finite";
    return false;
  }
  if (format == DepthExportFormat::COLMAP_WORKSPACE &&
      !undistorted_path.empty()) {
    *error =
        "undistorted_path has no meaning for colmap_workspace, whose "
        "undistorted model is in output_path";
    return false;
  }
  return alignment.IsValid(error);
}

std::string DepthExportSummary::ToText() const {
  std::ostringstream text;
  text << std::fixed << std::setprecision(2);
  std::vector<double> scale_residuals;
  std::vector<double> residuals;
  for (const Image& image : exported) {
    text << image.name << ": " << image.file;
    if (image.alignment) {
      text << ", " << image.alignment->num_points << " points, scale "
           << std::setprecision(4) << image.alignment->scale
           << std::setprecision(2) << ", median error "
           << 100 * image.alignment->scale_residual
           << " % after the best scale, " << 100 * image.alignment->residual
           << " % aligned";
      scale_residuals.push_back(image.alignment->scale_residual);
      residuals.push_back(image.alignment->residual);
    }
    text << "\n";
  }
  const auto list = [&text](const std::string& what,
                            const std::vector<std::string>& names) {
    for (const std::string& name : names) text << what << ": " << name << "\n";
  };
  list("image without map", images_without_map);
  list("image that is not in the model", images_without_model);
  list("image with too few points", images_with_few_points);
  text << "exported " << exported.size() << " depth maps";
  if (!residuals.empty()) {
    text << ", median error " << 100 * Median(scale_residuals)
         << " % after the best scale, " << 100 * Median(residuals)
         << " % aligned";
  }
  text << "\n";
  return text.str();
}

DepthExportSummary ExportDepthMaps(const std::string& database_path,
                                   const std::optional<std::string>& model_path,
                                   const std::string& output_path,
                                   const DepthExportOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  const bool needs_model =
      !options.undistorted_path.empty() ||
      options.format == DepthExportFormat::COLMAP_WORKSPACE;
  DGSFM_CHECK(model_path || !needs_model) << "a model is needed";
  CreateOutputFolder(output_path);
  return Exporter(database_path, model_path, output_path, options).Run();
}

}  // namespace dgsfm
