#include "sfm/joining/position_placement.h"

namespace dgsfm {

ModelGeoreference PlaceAtPositions(const GeoreferencingOptions& options,
                                   const PosePriors& priors,
                                   bool has_scale,
                                   JoinedModel* model,
                                   std::vector<std::string>* warnings) {
  ModelGeoreference result;
  if (!options.use_positions || !HasPositions(priors)) return result;
  const auto free =
      AlignToPositions(options, priors, std::nullopt, model->poses);
  const std::string reason = WhyUnusable(options, priors, free, model->poses);
  if (!reason.empty()) {
    warnings->push_back(UnusablePositionsText(reason, model->poses));
    return result;
  }
  const bool is_scaled =
      !has_scale && free->log_scale_stddev <= kMinDepthScaleStddev;
  const auto placed =
      is_scaled ? free : AlignToPositions(options, priors, 1.0, model->poses);
  if (!placed) return result;
  result.SetAlignment(*placed);
  result.log_scale_stddev_of_positions = free->log_scale_stddev;
  result.scale_source = is_scaled   ? ScaleSource::POSITIONS
                        : has_scale ? ScaleSource::RIGS
                                    : ScaleSource::DEPTH;
  if (!options.georeference) return result;
  model->Transform(placed->target_from_source);
  result.is_georeferenced = true;
  result.SetErrors(priors, model->poses);
  return result;
}

}  // namespace dgsfm
