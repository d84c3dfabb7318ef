// Options of everything that positions and gravity of images are used for.

#pragma once

#include "estimators/up_direction.h"

#include <string>

namespace dgsfm {

struct GeoreferencingOptions {
  // Whether models get the frame and unit of the positions of their images;
  // otherwise they keep their own.
  bool georeference = true;
  // Whether positions take part in positioning and bundle adjustment.
  bool use_positions = true;
  // Whether pairs leave that contradict the positions of their images.
  bool judge_pairs = true;
  // Whether models that no match connects become one in the frame of the
  // positions.
  bool join_models = true;
  // Whether models without the frame of positions are turned so that their z
  // axis points up, where gravity is known ...
  bool upright = true;
  // ... or guessed by cameras that are held level.
  bool upright_by_level_cameras = false;
  UpDirectionOptions up_direction;
  // Scale of the Cauchy loss of positions [standard deviations].
  double loss_scale = 2.0;
  // Positions that leave the scale of a model less certain than this are not
  // used: they have no extent beyond their errors [log].
  double max_log_scale_stddev = 0.2;
  // Pairs whose translation and distance by positions differ by more than this
  // factor leave [1].
  double max_pair_distance_ratio = 5.0;

  bool IsValid(std::string* error) const;
};

}  // namespace dgsfm
