#include "controllers/pose_prior_loader.h"

namespace dgsfm {

void BindPosePriors(PosePriorOptions* options,
                    CommandOptions* command_options) {
  command_options->Add("use_pose_priors",
                       &options->use_pose_priors,
                       "whether positions and gravity of images count: those "
                       "of pose_priors_path, else of the database, else of "
                       "EXIF");
  command_options->Add("pose_priors_path",
                       &options->path,
                       "positions of images, lines 'name a b c "
                       "[std_horizontal std_vertical]'; empty = none");
  command_options->Add("pose_priors_coordinates",
                       &options->coordinates,
                       "what a, b, c and the columns prior_t of COLMAP 3.8's "
                       "databases are: wgs84 (latitude, longitude [deg], "
                       "altitude [m]) or cartesian [m]");
  command_options->Add("pose_priors_std_horizontal",
                       &options->stddev_horizontal_m,
                       "standard deviation of positions without any [m]");
  command_options->Add("pose_priors_std_vertical",
                       &options->stddev_vertical_m,
                       "the same vertically [m]");
  command_options->Add("georeference_origin",
                       &options->origin,
                       "latitude,longitude,altitude of the frame's origin "
                       "[deg, deg, m]; empty = the median position");
}

}  // namespace dgsfm
