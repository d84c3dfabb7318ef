// The frame of a model by the positions and the gravity of its images.

#pragma once

#include "colmap_ext/pose_prior.h"
#include "estimators/position_alignment.h"
#include "sfm/georeferencing/georeferencing_options.h"
#include "sfm/mapping/bundle_adjustment.h"

#include <colmap/util/alignment.h>

#include <colmap/base/reconstruction.h>

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm {

// Networks for metric depth are off by a factor that their maps have in common:
// the scale by depth is not better known than this [log].
constexpr double kMinDepthScaleStddev = 0.03;

// What fixes the scale of a model that has positions.
enum class ScaleSource { NONE, POSITIONS, DEPTH, RIGS };
std::string ScaleSourceName(ScaleSource source);

// How a model lies to the positions of its images.
struct ModelGeoreference {
  // Whether the model is in the frame of the positions.
  bool is_georeferenced = false;
  ScaleSource scale_source = ScaleSource::NONE;
  // Images of the model with a position, and how many of these agree.
  size_t num_positions = 0;
  size_t num_inliers = 0;
  // Scale of the model by depth maps over that by positions, with their
  // standard deviations [1]; 0 if unknown.
  double scale_of_depth = 0;
  // The same of rigs.
  double scale_of_rigs = 0;
  double log_scale_stddev_of_depth = 0;
  double log_scale_stddev_of_positions = 0;
  double rotation_stddev_deg = 0;
  // Errors over the standard deviations that were given [1].
  double spread = 0;
  // Median distances from the positions [m].
  double median_horizontal_error_m = 0;
  double median_vertical_error_m = 0;
  // Images of each part that no match connects with the others, if there are
  // several.
  std::vector<size_t> part_sizes;
  // Center of each image minus its position [m].
  std::map<colmap::image_t, Eigen::Vector3d> errors;

  // Sets what an alignment with the positions shows.
  void SetAlignment(const PositionAlignment& alignment);
  // Sets `errors` and their medians by a model in the frame of the positions.
  void SetErrors(const PosePriors& priors, const colmap::Reconstruction& model);
  // Sets the median errors by `errors`.
  void MeasureErrors();
};

// L of the information L^T L of a covariance L^-1 L^-T.
Eigen::Matrix3d SqrtInformation(const Eigen::Matrix3d& covariance);

bool HasPositions(const PosePriors& priors);

// Why positions cannot be used for a model, by its alignment with them at a
// free scale; empty if they can.
std::string WhyUnusable(const GeoreferencingOptions& options,
                        const PosePriors& priors,
                        const std::optional<PositionAlignment>& free,
                        const colmap::Reconstruction& model);
std::string UnusablePositionsText(const std::string& reason,
                                  const colmap::Reconstruction& model);

// Vertical of the model by gravity or by how its cameras are held.
std::optional<UpDirection> UpOfModel(const GeoreferencingOptions& options,
                                     const PosePriors& priors,
                                     const colmap::Reconstruction& model);

// Aligns the model's centres with the positions of its images, with `scale`
// held if it is given. Nothing with fewer than three positions, or if these are
// at one place.
std::optional<PositionAlignment> AlignToPositions(
    const GeoreferencingOptions& options,
    const PosePriors& priors,
    const std::optional<double>& scale,
    const colmap::Reconstruction& model);

void TransformModel(const Similarity3d& new_from_old,
                    colmap::Reconstruction* model);

// The positions of the model's images as priors of their centres, with
// standard deviations as given times `stddev_factor`.
CenterPriors CenterPriorsOf(const GeoreferencingOptions& options,
                            const PosePriors& priors,
                            double stddev_factor,
                            const colmap::Reconstruction& model);

// Errors of the centres by their priors [standard deviations].
std::vector<double> CenterErrors(const CenterPriors& priors,
                                 const colmap::Reconstruction& model);

}  // namespace dgsfm
