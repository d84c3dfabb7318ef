#include "controllers/depth_exporter.h"

#include "colmap_ext/check.h"
#include "colmap_ext/database/depth_database.h"
#include "colmap_ext/database/scene_database.h"
#include "colmap_ext/depth/affine_depth.h"
#include "colmap_ext/depth/depth_undistortion.h"
#include "colmap_ext/formats/picture_file.h"
#include "colmap_ext/output_file.h"
#include "colmap_ext/parallel.h"
#include "colmap_ext/progress.h"
#include "controllers/confidence_map.h"
#include "controllers/dense_workspace.h"
#include "controllers/depth_export_files.h"
#include "controllers/depth_export_summary.h"
#include "controllers/depth_plot.h"
#include "controllers/initial_cloud.h"
#include "controllers/output_folder.h"
#include "controllers/sparse_model.h"
#include "controllers/splatting_depth.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <stdexcept>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

// Share of the inverse depths of all images that the range covers; nearer ones
// saturate.
constexpr double kInverseDepthQuantile = 0.999;

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
  // See DepthExportSummary.
  double agreeing_ratio = 0;
  double dropped_ratio = 0;
  bool has_lost_depth = false;
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
    const auto read = [&options](const std::string& path) {
      SparseModel model = ReadSparseModel(path);
      CheckPointsPath(options.points_path, {path, model.path});
      return model;
    };
    if (model_path) model_ = read(*model_path);
    if (options.format == DepthExportFormat::COLMAP_WORKSPACE) {
      undistorted_model_ = read(WorkspaceModelPath(output_path));
    } else if (!options.undistorted_path.empty()) {
      undistorted_model_ = read(options.undistorted_path);
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
    Claim(jobs, scales);
    // Maps are read twice, as all of them together need not fit into memory.
    if (model_ || is_for_splatting) {
      ForEach("Aligning depth maps", &jobs, [&](Job* job, DepthMap map) {
        Prepare(job, std::move(map));
      });
    }
    DropImagesWithFewPoints(&jobs);
    double max_inverse_depth = 0;
    for (const Job& job : jobs) {
      max_inverse_depth = std::max(max_inverse_depth, job.near_inverse_depth);
    }
    StartCloud();
    // One scale for all images: see WriteSplattingParameters().
    splatting_scale_ = SplattingScale(max_inverse_depth);
    if (options_.multi_view) {
      RefineAndWrite(&jobs);
    } else {
      ForEach("Writing depth maps", &jobs, [&](Job* job, DepthMap map) {
        if (job->alignment) job->alignment->Apply(&map);
        if (cloud_) AddToCloud(*job, map);
        job->has_lost_depth = !Write(*job, std::move(map));
      });
    }
    for (Job& job : jobs) {
      scales[job.name] = splatting_scale_;
      if (job.has_lost_depth) summary_.images_out_of_range.push_back(job.name);
      summary_.exported.push_back({job.name,
                                   DepthExportFile(job.name, options_.format),
                                   std::move(job.alignment),
                                   job.agreeing_ratio,
                                   job.dropped_ratio});
    }
    if (summary_.images_out_of_range.size() == jobs.size()) {
      throw std::runtime_error(
          "no depth of any image is within 65534 steps of png_scale: the maps "
          "in " +
          output_path_ + " are all unknown; choose a larger png_scale");
    }
    summary_.multi_view = options_.multi_view;
    if (is_for_splatting) WriteSplattingParameters(output_path_, scales);
    if (options_.format == DepthExportFormat::COLMAP_WORKSPACE) {
      WriteFusionList(output_path_, NamesOfExported());
    }
    if (cloud_) {
      summary_.num_points = cloud_->Write(
          options_.points_path, options_.image_path, options_.num_threads);
    }
    if (model_) WriteAlignments(output_path_, summary_);
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
      image_ids_[image.Name()] = image_id;
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

  void Claim(const std::vector<Job>& jobs, const SplattingScales& scales) {
    std::vector<std::string> images;
    for (const Job& job : jobs) images.push_back(job.name);
    ClaimExportFiles(
        output_path_, model_.has_value(), images, scales, options_);
  }

  template <typename Function>
  void ForEach(const std::string& label,
               std::vector<Job>* jobs,
               const Function& function) const {
    Progress progress(label, jobs->size());
    ParallelFor(jobs->size(), options_.num_threads, [&](size_t i) {
      Job& job = (*jobs)[i];
      std::optional<DepthMap> map = Read(job);
      if (map) {
        function(&job, *std::move(map));
      } else {
        job.has_few_points = true;
      }
      progress.Step();
    });
  }

  // The map of an image, nothing if it is relative and has too few points.
  // Opens the database by itself: connections are not shared by threads.
  std::optional<DepthMap> Read(const Job& job) const {
    DepthMap map = DepthDatabase(database_path_, DepthDatabase::Mode::READ_ONLY)
                       .ReadDepthMap(job.image_id);
    if (!IsAffine(map.unit)) return map;
    if (!model_) {
      throw std::runtime_error(
          "the map of image " + job.name +
          " is relative: it becomes depth by a model alone (--input_path)");
    }
    if (!ConvertByPoints(*model_, job.name, &map)) return std::nullopt;
    return map;
  }

  void DropImagesWithFewPoints(std::vector<Job>* jobs) {
    const auto last =
        std::stable_partition(jobs->begin(), jobs->end(), [](const Job& job) {
          return !job.has_few_points;
        });
    std::vector<std::string>& dropped = summary_.images_with_few_points;
    for (auto job = last; job != jobs->end(); ++job) {
      dropped.push_back(job->name);
    }
    jobs->erase(last, jobs->end());
    if (!jobs->empty()) return;
    throw std::runtime_error("no depth map is exported: none of the " +
                             std::to_string(dropped.size()) +
                             " images with a map, such as " + dropped.front() +
                             ", sees enough points that fit it in the model " +
                             model_->path + " (DepthAlignment.min_num_points)");
  }

  void StartCloud() {
    if (options_.points_path.empty()) return;
    cloud_ = std::make_unique<InitialCloud>(
        undistorted_model_ ? *undistorted_model_ : *model_,
        image_ids_,
        options_.num_points);
  }

  // Each job has an alignment.
  void RefineAndWrite(std::vector<Job>* jobs) const {
    std::vector<ViewToRefine> views;
    for (const Job& job : *jobs) views.push_back({job.name, *job.alignment});
    MultiViewRefinementOptions refinement = options_.refinement;
    refinement.alignment = options_.alignment;
    refinement.num_threads = options_.num_threads;
    // Maps were read before, so that they are there.
    MultiViewRefinement(*model_, refinement, &views, [&](size_t i) {
      return Read((*jobs)[i]).value();
    }).Run([&](size_t i, RefinedDepth refined) {
      Job& job = (*jobs)[i];
      job.agreeing_ratio = refined.agreeing_ratio;
      job.dropped_ratio = refined.dropped_ratio;
      if (!options_.confidence_path.empty()) WriteConfidence(job, refined);
      // Where none agrees depth may be anything.
      DepthMap sure = refined.depth_map;
      for (size_t k = 0; cloud_ && k < sure.values.size(); ++k) {
        if (refined.confidence[k] <= 0.5f) sure.values[k] = 0;
      }
      if (cloud_) AddToCloud(job, std::move(sure));
      job.has_lost_depth = !Write(job, std::move(refined.depth_map));
    });
  }

  // Confidences move with the pixels of the depth map.
  void WriteConfidence(const Job& job, const RefinedDepth& refined) const {
    DepthMap map = refined.depth_map;
    map.values = refined.confidence;
    for (size_t i = 0; i < map.values.size(); ++i) {
      if (refined.depth_map.values[i] <= 0) map.values[i] = 0;
    }
    map = ForOutput(job, std::move(map));
    WriteBesideName(
        options_.confidence_path, job.name, [&](const std::string& path) {
          WriteConfidencePicture(path, map);
        });
  }

  void Prepare(Job* job, DepthMap depth_map) const {
    if (model_) {
      const std::vector<DepthCorrespondence> points =
          FindDepthCorrespondences(*model_, job->name, depth_map);
      job->alignment = AlignDepth(
          points,
          static_cast<double>(job->camera->Width()) / job->camera->Height(),
          options_.alignment);
      job->has_few_points = !job->alignment.has_value();
      if (job->has_few_points) return;
      if (!options_.plot_path.empty()) {
        WriteBesideName(
            options_.plot_path, job->name, [&](const std::string& path) {
              WritePicture(path, PlotAlignment(*job->alignment, points));
            });
      }
      job->alignment->Apply(&depth_map);
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

  // The map of the image that the output is for.
  static DepthMap ForOutput(const Job& job, DepthMap map) {
    if (job.undistorted_camera == nullptr) return map;
    return UndistortDepth(map, *job.camera, *job.undistorted_camera);
  }

  void AddToCloud(const Job& job, DepthMap map) const {
    cloud_->Add(job.name, ForOutput(job, std::move(map)));
  }

  template <typename Function>
  static void WriteBesideName(const std::string& folder,
                              const std::string& image_name,
                              const Function& write) {
    const fs::path path = PathInside(folder, DepthExportPicture(image_name));
    CreateOutputFolder(path.parent_path().string());
    write(path.string());
  }

  // False where the map has depth and the file cannot hold any.
  bool Write(const Job& job, DepthMap depth_map) const {
    depth_map = ForOutput(job, std::move(depth_map));
    if (options_.format == DepthExportFormat::COLMAP_WORKSPACE) {
      WriteWorkspaceMaps(output_path_,
                         job.name,
                         std::move(depth_map),
                         *job.undistorted_camera);
      return true;
    }
    const std::string path =
        PathInside(output_path_, DepthExportFile(job.name, options_.format));
    // Images in sub-folders have their maps in the same ones.
    CreateOutputFolder(fs::path(path).parent_path().string());
    return WriteExportedMap(path, depth_map, options_, splatting_scale_);
  }

  std::vector<std::string> NamesOfExported() const {
    std::vector<std::string> names;
    for (const DepthExportSummary::Image& image : summary_.exported) {
      names.push_back(image.name);
    }
    return names;
  }

  // The images of the models or, without any, of the database, without scales.
  SplattingScales ImagesForSplatting(const std::vector<Job>& jobs) const {
    SplattingScales scales;
    for (const auto* model : {&model_, &undistorted_model_}) {
      if (!*model) continue;
      for (const auto& [name, image] : (*model)->images) scales[name] = 0;
    }
    if (model_) return scales;
    for (const Job& job : jobs) scales[job.name] = 0;
    for (const std::string& name : summary_.images_without_map) {
      scales[name] = 0;
    }
    return scales;
  }

  const std::string database_path_;
  const std::string output_path_;
  const DepthExportOptions& options_;
  std::optional<SparseModel> model_;
  std::optional<SparseModel> undistorted_model_;
  std::map<std::string, colmap::image_t> image_ids_;
  std::unique_ptr<InitialCloud> cloud_;
  // See SplattingScale.
  double splatting_scale_ = 0;
  DepthExportSummary summary_;
};

}  // namespace

DepthExportSummary ExportDepthMaps(const std::string& database_path,
                                   const std::optional<std::string>& model_path,
                                   const std::string& output_path,
                                   const DepthExportOptions& options) {
  std::string error;
  DGSFM_CHECK(options.IsValid(&error)) << error;
  DGSFM_CHECK(model_path || options.OptionThatNeedsModel().empty())
      << options.OptionThatNeedsModel() << " needs a model";
  return Exporter(database_path, model_path, output_path, options).Run();
}

}  // namespace dgsfm
