// Configurations in which matches do not tell the whole relative pose.

#pragma once

#include "estimators/random.h"
#include "estimators/two_view/two_view_data.h"
#include "estimators/two_view/two_view_model.h"

namespace dgsfm {

// Smallest support of a model that is not a coincidence of its own sample.
constexpr int kMinNumInliers = 8;

// All tests look at the inliers of a model; each holds if at least 80 % of
// them fit a simpler explanation within `max_error_px` in the second image.

// A homography, of the best of 100 samples and refined.
bool IsPlanar(const TwoViewData& inliers,
              double max_error_px,
              SplitMix64* random);

// A rotation between cameras with the focal lengths of the model.
bool IsRotationOnly(const TwoViewData& inliers,
                    const TwoViewModel& model,
                    double max_error_px);

// No motion of the image points: those of a watermark or a frame. Images of
// the same size and principal point are meant.
bool IsStationary(const TwoViewData& inliers, double max_error_px);

}  // namespace dgsfm
