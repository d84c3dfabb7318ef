// Soft knowledge of a focal length.

#pragma once

namespace dgsfm {

// Normal distribution of the logarithm of a focal length.
struct FocalPrior {
  // Mean, as a focal length [px]; 0 where log_stddev is 0.
  double focal_px = 0;
  // Standard deviation of the logarithm [1]; 0 = nothing is known.
  double log_stddev = 0;

  bool Exists() const { return log_stddev > 0; }
};

}  // namespace dgsfm
