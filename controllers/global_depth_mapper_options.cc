#include "controllers/global_depth_mapper_options.h"

namespace dgsfm {

namespace {

constexpr char kGroup[] = "DepthGlobalMapper";

void BindPairStages(DepthGlobalMapperOptions* options,
                    CommandOptions* command_options) {
  OptionGroup(kGroup, command_options)
      .Add("min_pair_score",
           &options->view_graph.min_pair_score,
           "pairs with an imported score up to this are removed [1]")
      .Add("min_triplet_support",
           &options->view_graph.min_triplet_support,
           "pairs with a mean triplet support up to this are removed, 0 = "
           "none [1]")
      .Add("num_rotation_averaging_rounds",
           &options->averaging.num_rotation_averaging_rounds,
           "rounds of rotation averaging, each with a filter")
      .Add("max_rotation_error",
           &options->averaging.max_rotation_error_deg,
           "pairs farther off the averaged rotations are removed [deg]")
      .Add("max_log_scale_error",
           &options->averaging.max_log_scale_error,
           "pairs farther off the averaged scales lose theirs [log]")
      .Add("max_translation_error_ratio",
           &options->averaging.max_translation_error_ratio,
           "pairs farther off the averaged translations are removed [length "
           "of the translation] ...")
      .Add("max_translation_error_factor",
           &options->averaging.max_translation_error_factor,
           "... if also by this times the median error of all pairs [1]")
      .Add("track_min_num_views",
           &options->tracks.min_num_views_per_track,
           "images a track must be seen in")
      .Add("track_min_num_per_view",
           &options->tracks.min_num_tracks_per_view,
           "images with fewer tracks also use two-view tracks")
      .Add("init_use_depth",
           &options->position_initialization.use_depth,
           "start centres and points from depth");
}

void BindBundleAdjustment(ModelRefinementOptions* options,
                          CommandOptions* command_options) {
  BundleAdjustmentOptions& adjustment = options->bundle_adjustment;
  OptionGroup(kGroup, command_options)
      .Add("ba_num_rounds",
           &options->num_bundle_adjustment_rounds,
           "rounds of bundle adjustment, each with a filter")
      .Add("ba_max_num_iterations",
           &adjustment.max_num_iterations,
           "iterations of each bundle adjustment")
      .Add("ba_function_tolerance",
           &adjustment.function_tolerance,
           "relative decrease of the cost that ends bundle adjustment [1]")
      .Add("ba_loss_scale",
           &adjustment.loss_scale_px,
           "residual from which the soft L1 loss grows linearly; in the end "
           "at most [px]")
      .Add("ba_refine_focal_length",
           &adjustment.intrinsics.refine_focal_length,
           "refine focal lengths")
      .Add("ba_refine_extra_params",
           &adjustment.intrinsics.refine_extra_params,
           "refine distortion")
      .Add("ba_refine_principal_point",
           &options->refine_principal_point,
           "refine principal points once the model is complete")
      .Add("ba_principal_point_stddev",
           &adjustment.intrinsics.principal_point_stddev_ratio,
           "prior of the principal point [larger image side]")
      .Add("ba_extra_params_stddev",
           &adjustment.intrinsics.extra_params_stddev,
           "prior of distortion parameters [1]");
}

void BindRefinement(ModelRefinementOptions* options,
                    CommandOptions* command_options) {
  OptionGroup(kGroup, command_options)
      .Add("gp_max_num_iterations",
           &options->global_positioning.max_num_iterations,
           "iterations of global positioning")
      .Add("gp_loss_scale",
           &options->global_positioning.loss_scale,
           "Huber threshold of global positioning [sine of angle]")
      .Add("max_angular_error",
           &options->max_angular_error_deg,
           "observations farther off after positioning are removed [deg]");
  BindBundleAdjustment(options, command_options);
  OptionGroup(kGroup, command_options)
      .Add("max_reprojection_error",
           &options->max_reprojection_error_px,
           "observations farther off after the last round are removed [px]")
      .Add("min_triangulation_angle",
           &options->min_triangulation_angle_deg,
           "points with a smaller triangulation angle are removed [deg] ...")
      .Add("min_num_triangulated_per_image",
           &options->min_num_triangulated_per_image,
           "... unless an image that sees them has fewer others")
      .Add("tri_max_epipolar_error",
           &options->max_epipolar_error_px,
           "distance from the epipolar line of matches to triangulate [px]")
      .Add("max_completion_error",
           &options->max_completion_error_px,
           "largest error when tracks are completed and merged [px]")
      .Add("max_neighbor_distance_ratio",
           &options->max_neighbor_distance_ratio,
           "points of two images are removed if their distance from a camera "
           "differs by more than this factor from that of all neighbours in "
           "the image (0 = off)")
      .Add("min_num_points_per_image",
           &options->min_num_points_per_image,
           "images with fewer points are not registered");
}

void BindMapper(DepthGlobalMapperOptions* options,
                CommandOptions* command_options) {
  BindPairStages(options, command_options);
  BindRefinement(&options->refinement, command_options);
  OptionGroup group(kGroup, command_options);
  group
      .Add("min_model_size",
           &options->min_model_size,
           "models with fewer images are not written, unless the database has "
           "fewer")
      .Add("refine_sensor_from_rig",
           &options->refine_sensor_from_rig,
           "whether known poses of cameras in their rigs stay refined; unknown "
           "ones, and those that the model contradicts, always do")
      .Add("multiple_models",
           &options->multiple_models,
           "one model per connected component, else only the largest");
  const auto skip = [&](const std::string& stage, bool* value) {
    group.Add("skip_" + stage, value, "leave this stage out");
  };
  skip("static_background", &options->skip_static_background);
  skip("depth_reliability", &options->skip_depth_reliability);
  skip("pair_scores", &options->skip_pair_scores);
  skip("focal_averaging", &options->skip_focal_averaging);
  skip("reverification", &options->skip_reverification);
  skip("rotation_recovery", &options->skip_rotation_recovery);
  skip("scale_averaging", &options->skip_scale_averaging);
  skip("translation_averaging", &options->skip_translation_averaging);
  skip("global_positioning", &options->skip_global_positioning);
  skip("one_center_start", &options->skip_one_center_start);
  skip("bundle_adjustment", &options->skip_bundle_adjustment);
  skip("self_calibration", &options->skip_self_calibration);
  skip("camera_ties", &options->skip_camera_ties);
  skip("loss_adaptation", &options->skip_loss_adaptation);
  skip("retriangulation", &options->skip_retriangulation);
  skip("image_resection", &options->skip_image_resection);
  skip("match_completion", &options->skip_match_completion);
  skip("pair_judging", &options->skip_pair_judging);
  skip("rotation_alternatives", &options->averaging.skip_alternatives);
}

void BindSize(GlobalDepthMapperOptions* options,
              CommandOptions* command_options) {
  command_options->Add("max_num_keypoints_per_image",
                       &options->max_num_keypoints_per_image,
                       "matched key points of an image that are used, with "
                       "dense matches; 0 = all");
  TrackOptions& tracks = options->mapper.tracks;
  command_options->Add("max_num_tracks",
                       &tracks.max_num_tracks,
                       "tracks of a model, the most informative ones; 0 = all");
  command_options->Add("max_num_observations_per_image",
                       &tracks.max_num_observations_per_image,
                       "points of a model that an image sees, the most "
                       "informative ones, which bounds the memory; 0 = all");
  command_options->Add("max_num_start_observations_per_image",
                       &tracks.max_num_start_observations_per_image,
                       "points of a model of many images that an image sees "
                       "until the model is completed; 0 = all");
  command_options->Add("min_num_images_to_bound_start",
                       &tracks.min_num_images_to_bound_start,
                       "images from which on a model is one of many images");
  command_options->Add("memory_limit_gb",
                       &options->memory_limit_gb,
                       "memory that the mapping may take: if it is predicted "
                       "to need more, it ends with an error that names the "
                       "remedy before the work begins [GB]; 0 = any");
}

void BindGeoreferencing(GlobalDepthMapperOptions* options,
                        CommandOptions* command_options) {
  GeoreferencingOptions& georeferencing = options->mapper.georeferencing;
  command_options->Add("georeference",
                       &georeferencing.georeference,
                       "whether models get the frame and unit of the positions "
                       "(east, north, up [m]), else they keep their own");
  command_options->Add("join_models",
                       &georeferencing.join_models,
                       "whether models that no match connects become one in "
                       "the frame of the positions");
  command_options->Add("upright",
                       &georeferencing.upright,
                       "whether the z axis of models without that frame points "
                       "up, if gravity is known");
  command_options->Add("upright_by_level_cameras",
                       &georeferencing.upright_by_level_cameras,
                       "whether the vertical is guessed by cameras held level "
                       "where gravity is unknown");
  OptionGroup(kGroup, command_options)
      .Add("pp_use_positions",
           &georeferencing.use_positions,
           "whether positions take part in positioning and bundle adjustment")
      .Add("pp_judge_pairs",
           &georeferencing.judge_pairs,
           "whether pairs that contradict the positions of their images leave")
      .Add("gravity_refine_rotations",
           &options->mapper.averaging.gravity.use_gravity,
           "whether averaged rotations are refined by the gravity of images")
      .Add("gravity_stddev",
           &options->mapper.averaging.gravity.stddev_deg,
           "of gravity about each horizontal axis, at least [deg]")
      .Add("pp_loss_scale",
           &georeferencing.loss_scale,
           "Cauchy loss of positions [standard deviations]")
      .Add("pp_max_log_scale_stddev",
           &georeferencing.max_log_scale_stddev,
           "positions that leave the scale less certain are not used [log]")
      .Add("pp_max_pair_distance_ratio",
           &georeferencing.max_pair_distance_ratio,
           "factor between the distance of two images by depth and by "
           "positions beyond which their pair leaves [1]")
      .Add("up_max_roll",
           &georeferencing.up_direction.max_roll_deg,
           "cameras rolled by less than this are held level [deg]")
      .Add("up_min_share",
           &georeferencing.up_direction.min_share,
           "share of the cameras that must be level for an upright model");
}

// The paper gives iterations; its authors' code ends them at this.
constexpr double kPaperTolerance = 1e-6;

void ApplyPaperPreset(PairVerificationOptions* options) {
  TwoViewDepthOptions& two_view = options->two_view;
  two_view.paper = true;
  two_view.max_epipolar_error_px = 1.0;
  two_view.max_reprojection_error_px = 16.0;
  two_view.min_num_trials = 1000;
  two_view.max_num_trials = 1000;
  options->filter_depth = true;
  options->depth_consistency.max_reprojection_error_px = 12.0;
  options->depth_consistency.max_depth_error_ratio = 0.3;
  options->depth_consistency.tolerate_depth_error = false;
  options->depth_noise_factor = 0;
  options->min_num_inliers = 15;
  options->min_inlier_ratio = 0.25;
}

}  // namespace

void BindOptions(GlobalDepthMapperOptions* options,
                 CommandOptions* command_options) {
  BindVerificationOptions(&options->verifier, command_options);
  command_options->Add("image_path",
                       &options->image_path,
                       "folder of the images, for colours and EXIF; empty = "
                       "none");
  command_options->Add("use_exif",
                       &options->use_exif,
                       "whether focal length and camera that EXIF data name "
                       "count where no prior focal length is given");
  command_options->Add("ignore_rigs",
                       &options->ignore_rigs,
                       "whether images of rigs of several cameras are mapped "
                       "as if each moved by itself");
  command_options->Add("rig_config_path",
                       &options->rig_config_path,
                       "rig_config.json of COLMAP's rig_configurator, in place "
                       "of the rigs of the database");
  command_options->AddRequired(
      "output_path",
      &options->output_path,
      "folder of the models, created if missing; models of "
      "an earlier run in it are replaced");
  command_options->Add("image_list_path",
                       &options->image_list_path,
                       "file with the names of the images to map, one a line; "
                       "statuses of pairs are not stored then; empty = all");
  command_options->Add("pair_scores_path",
                       &options->pair_scores_path,
                       "pair scores (Doppelgangers++), lines 'name1 name2 "
                       "score', .csv or .json; empty = none");
  command_options->Add("share_intrinsics",
                       &options->mapper.share_intrinsics,
                       "one camera in the model for images whose cameras turn "
                       "out to be the same");
  command_options->Add("measure_repeatability",
                       &options->mapper.measure_repeatability,
                       "whether the report gets the differences of the poses "
                       "that two halves of the points give");
  command_options->Add("split_cameras",
                       &options->mapper.split_cameras,
                       "cameras of their own for images of one camera entry "
                       "whose focal lengths turn out to differ");
  BindSize(options, command_options);
  command_options->Add("write_pair_statuses",
                       &options->write_pair_statuses,
                       "whether the database gets the pairs as they are "
                       "verified, from which a run that was broken off goes "
                       "on, and the status of each in the end");
  command_options->Add("write_html_report",
                       &options->write_html_report,
                       "whether report.html is written, to look at in a "
                       "browser: 1, 0, or -1 = if image_path is given");
  command_options->Add(
      "paper", &options->paper, "method and thresholds of the paper");
  BindPosePriors(&options->pose_priors, command_options);
  BindGeoreferencing(options, command_options);
  BindMapper(&options->mapper, command_options);
}

std::string MappingText(GlobalDepthMapperOptions options) {
  options.output_path.clear();
  options.verifier.database_path.clear();
  options.verifier.verification.num_threads = -1;
  options.memory_limit_gb = 0;
  CommandOptions command_options("", "");
  BindOptions(&options, &command_options);
  return command_options.ProjectText();
}

void ApplyPaperPreset(GlobalDepthMapperOptions* options) {
  ApplyPaperPreset(&options->verifier.verification);
  options->use_exif = false;
  options->verifier.intrinsics_prior = "calibrated";
  DepthGlobalMapperOptions& mapper = options->mapper;
  mapper.view_graph.min_pair_score = 0.8;
  mapper.view_graph.min_triplet_support = 0.6;
  mapper.averaging.scale_averaging.max_num_irls_iterations = 30;
  mapper.tracks.min_num_views_per_track = 3;
  mapper.tracks.min_num_tracks_per_view = 0;
  mapper.position_initialization.use_depth = true;
  options->max_num_keypoints_per_image = 0;
  options->pose_priors.use_pose_priors = false;
  mapper.georeferencing.upright = false;
  mapper.skip_static_background = true;
  mapper.skip_depth_reliability = true;
  mapper.skip_reverification = true;
  mapper.skip_translation_averaging = true;
  mapper.averaging.skip_alternatives = true;
  mapper.skip_self_calibration = true;
  mapper.skip_loss_adaptation = true;
  mapper.skip_rotation_recovery = true;
  mapper.skip_one_center_start = true;
  mapper.skip_retriangulation = true;
  mapper.skip_pair_judging = true;

  ModelRefinementOptions& refinement = mapper.refinement;
  refinement.global_positioning.max_num_iterations = 100;
  refinement.global_positioning.function_tolerance = kPaperTolerance;
  refinement.num_bundle_adjustment_rounds = 3;
  refinement.min_num_triangulated_per_image = 0;
  refinement.max_neighbor_distance_ratio = 0;
  refinement.refine_principal_point = false;
  BundleAdjustmentOptions& adjustment = refinement.bundle_adjustment;
  adjustment.max_num_iterations = 100;
  adjustment.function_tolerance = kPaperTolerance;
  adjustment.loss_scale_px = 1.0;
  adjustment.intrinsics.refine_focal_length = true;
  adjustment.intrinsics.refine_extra_params = false;
  adjustment.intrinsics.refine_principal_point = false;
}

void SetOverPreset(const std::function<void()>& set,
                   GlobalDepthMapperOptions* options) {
  set();
  if (!options->paper) return;
  *options = GlobalDepthMapperOptions();
  options->paper = true;
  ApplyPaperPreset(options);
  set();
}

}  // namespace dgsfm
