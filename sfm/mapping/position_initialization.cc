#include "sfm/mapping/position_initialization.h"

#include "colmap_ext/check.h"
#include "colmap_ext/pose_access.h"
#include "estimators/median.h"
#include "estimators/optimization/ray_intersection.h"
#include "sfm/mapping/center_chain.h"
#include "sfm/mapping/rig_model.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

namespace dgsfm {

namespace {

// Tracks a resected centre must rest on; two determine it, the rest reveals
// wrong ones.
constexpr int kMinNumResectionTracks = 6;
// Rounds in which frames place images, which place points and other frames.
constexpr int kNumFrameRounds = 2;
// Weight of a seed pair stops to grow beyond this parallax [deg].
constexpr double kGoodParallaxDeg = 15.0;
// Seed pairs that are tried, until one reaches all images.
constexpr size_t kMaxNumSeeds = 20;

struct Observation {
  int image = 0;
  // Viewing ray of the feature, R_i^T K_i^-1 x, with unit z in the camera.
  Eigen::Vector3d direction_in_world;
  // s_i D_i(x), or 0 where unknown.
  double depth = 0;

  // With unit length.
  Eigen::Vector3d RayInWorld() const { return direction_in_world.normalized(); }
};

class PositionInitializer {
 public:
  PositionInitializer(const ImageIndex& index,
                      const PairGeometries& pairs,
                      const KeypointDepthMap& depths,
                      const ImageScales& scales,
                      const std::vector<colmap::Track>& tracks,
                      const PositionInitializationOptions& options,
                      double min_triangulation_angle_deg,
                      const FrameMembers& frames,
                      const AveragedCenters& averaged_centers,
                      colmap::Reconstruction* reconstruction)
      : index_(index),
        pairs_(pairs),
        scales_(options.use_depth ? scales : ImageScales()),
        tracks_(tracks),
        frames_(frames),
        averaged_centers_(averaged_centers),
        min_triangulation_angle_deg_(min_triangulation_angle_deg),
        reconstruction_(reconstruction),
        centers_(index.Size()),
        points_(tracks.size()),
        tracks_of_images_(index.Size()),
        num_placed_tracks_(index.Size(), 0) {
    CollectObservations(depths);
  }

  size_t Run() {
    if (PlaceScaledImages()) {
      Grow();
    } else {
      GrowWithoutScales();
    }
    for (int round = 0; !frames_.empty() && round < kNumFrameRounds; ++round) {
      PlaceFrames();
      for (size_t i = 0; i < tracks_.size(); ++i) PlaceTrack(i);
      GrowByResection();
    }
    if (!frames_.empty()) PlaceFrames();
    return WriteToReconstruction();
  }

 private:
  void CollectObservations(const KeypointDepthMap& depths) {
    observations_.resize(tracks_.size());
    for (size_t i = 0; i < tracks_.size(); ++i) {
      observations_[i].reserve(tracks_[i].Length());
      for (const colmap::TrackElement& element : tracks_[i].Elements()) {
        const colmap::Image& image = reconstruction_->Image(element.image_id);
        const Eigen::Vector2d normalized =
            reconstruction_->Camera(image.CameraId())
                .ImageToWorld(image.Point2D(element.point2D_idx).XY());
        Observation observation;
        observation.image = index_.Of(element.image_id);
        observation.direction_in_world =
            CamFromWorld(image).rotation.conjugate() * normalized.homogeneous();
        const auto scale = scales_.find(element.image_id);
        const auto depth = depths.find(element.image_id);
        if (scale != scales_.end() && depth != depths.end()) {
          observation.depth =
              scale->second * depth->second.depths[element.point2D_idx];
        }
        observations_[i].push_back(observation);
        tracks_of_images_[observation.image].push_back(int(i));
      }
    }
  }

  bool PlaceScaledImages() {
    centers_ = ChainScaledCenters(index_, pairs_, scales_, *reconstruction_);
    return std::any_of(centers_.begin(),
                       centers_.end(),
                       [](const auto& center) { return center.has_value(); });
  }

  // Median angle between the two rays of tracks that both images see [deg].
  double MedianParallaxDeg(int image1, int image2) const {
    std::vector<double> angles;
    for (const int track : tracks_of_images_[image1]) {
      std::optional<Eigen::Vector3d> ray1, ray2;
      for (const Observation& observation : observations_[track]) {
        if (observation.image == image1) ray1 = observation.RayInWorld();
        if (observation.image == image2) ray2 = observation.RayInWorld();
      }
      if (ray1 && ray2) angles.push_back(AngleDeg(*ray1, *ray2));
    }
    return angles.empty() ? 0 : Median(angles);
  }

  // Two images that a model may start from.
  struct Seed {
    int image1 = 0;
    int image2 = 0;
    const PairGeometry* pair = nullptr;
  };
  using Images = std::set<int>;

  // The pair of many inliers and much parallax, among those that are not within
  // what was reached before.
  std::optional<Seed> BestSeed(const std::vector<Images>& reached) const {
    std::optional<Seed> best;
    double best_score = -1;
    for (const auto& [pair_id, pair] : pairs_) {
      const auto [image_id1, image_id2] = ImageIdsOfPair(pair_id);
      const int image1 = index_.Of(image_id1);
      const int image2 = index_.Of(image_id2);
      if (pair.status != PairStatus::VALID || image1 < 0 || image2 < 0 ||
          pair.cam2_from_cam1.translation.norm() == 0 ||
          double(pair.NumInliers()) * kGoodParallaxDeg <= best_score ||
          std::any_of(
              reached.begin(), reached.end(), [&](const Images& images) {
                return images.count(image1) > 0 && images.count(image2) > 0;
              })) {
        continue;
      }
      const double score =
          double(pair.NumInliers()) *
          std::min(MedianParallaxDeg(image1, image2), kGoodParallaxDeg);
      if (score <= best_score) continue;
      best_score = score;
      best = {image1, image2, &pair};
    }
    return best;
  }

  void Grow() {
    for (size_t i = 0; i < tracks_.size(); ++i) PlaceTrack(i);
    GrowByResection();
  }

  void GrowFromAveragedCenters() {
    for (const auto& [image_id, center] : averaged_centers_) {
      centers_[index_.Of(image_id)] = center;
    }
    Grow();
  }

  void GrowFrom(const Seed& seed) {
    centers_.assign(centers_.size(), std::nullopt);
    points_.assign(points_.size(), std::nullopt);
    num_placed_tracks_.assign(num_placed_tracks_.size(), 0);
    centers_[seed.image1] = Eigen::Vector3d::Zero();
    const Rigid3d& cam2_from_cam1 = seed.pair->cam2_from_cam1;
    centers_[seed.image2] = ChainCenter(
        Eigen::Vector3d::Zero(),
        CamFromWorld(reconstruction_->Image(index_.IdOf(seed.image2))).rotation,
        cam2_from_cam1,
        1 / cam2_from_cam1.translation.norm());
    Grow();
  }

  Images PlacedImages() const {
    Images images;
    for (int image = 0; image < index_.Size(); ++image) {
      if (centers_[image]) images.insert(image);
    }
    return images;
  }

  // From averaged centres, the best seed, or one that reaches more images;
  // pairs within what an earlier one reached would reach the same.
  void GrowWithoutScales() {
    GrowFromAveragedCenters();
    std::vector<Images> reached = {PlacedImages()};
    size_t num_best = reached.front().size();
    auto best = std::make_tuple(centers_, points_, num_placed_tracks_);
    while (reached.size() < kMaxNumSeeds && num_best < size_t(index_.Size())) {
      const std::optional<Seed> seed = BestSeed(reached);
      if (!seed) break;
      GrowFrom(*seed);
      const Images& images = reached.emplace_back(PlacedImages());
      if (images.size() <= num_best) continue;
      num_best = images.size();
      best = {centers_, points_, num_placed_tracks_};
    }
    std::tie(centers_, points_, num_placed_tracks_) = std::move(best);
  }

  // Places a track from depth if a placed image has it, else by triangulation.
  void PlaceTrack(size_t track) {
    if (points_[track]) return;
    std::vector<Eigen::Vector3d> lifted;
    std::vector<Eigen::Vector3d> centers;
    std::vector<Eigen::Vector3d> rays;
    for (const Observation& observation : observations_[track]) {
      if (!centers_[observation.image]) continue;
      centers.push_back(*centers_[observation.image]);
      rays.push_back(observation.RayInWorld());
      if (observation.depth > 0) {
        lifted.push_back(centers.back() +
                         observation.depth * observation.direction_in_world);
      }
    }
    if (!lifted.empty()) {
      points_[track] = ComponentwiseMedian(lifted);
    } else {
      points_[track] =
          TriangulateRays(centers, rays, min_triangulation_angle_deg_);
    }
    if (!points_[track]) return;
    for (const Observation& observation : observations_[track]) {
      ++num_placed_tracks_[observation.image];
    }
  }

  // The image that sees most placed tracks goes first: its centre is the
  // surest, and places tracks for the others. Each image has one try.
  void GrowByResection() {
    std::vector<char> is_tried(index_.Size(), 0);
    while (true) {
      int next = -1;
      for (int image = 0; image < index_.Size(); ++image) {
        if (!centers_[image] && !is_tried[image] &&
            num_placed_tracks_[image] >= kMinNumResectionTracks &&
            (next < 0 ||
             num_placed_tracks_[image] > num_placed_tracks_[next])) {
          next = image;
        }
      }
      if (next < 0) return;
      is_tried[next] = 1;
      std::vector<Eigen::Vector3d> points;
      std::vector<Eigen::Vector3d> rays;
      for (const int track : tracks_of_images_[next]) {
        if (!points_[track]) continue;
        points.push_back(*points_[track]);
        for (const Observation& observation : observations_[track]) {
          if (observation.image == next) {
            rays.push_back(observation.RayInWorld());
          }
        }
      }
      centers_[next] = ResectCenter(points, rays);
      if (!centers_[next]) continue;
      for (const int track : tracks_of_images_[next]) PlaceTrack(track);
    }
  }

  // Brings the start to the unit of the rigs, and the images of each frame to
  // where its placed images have the frame.
  void PlaceFrames() {
    WriteCenters();
    const auto scale = ModelFromRigScale(frames_, *reconstruction_);
    if (scale && *scale > 0) {
      Rescale(1 / *scale);
      WriteCenters();
    }
    JoinFrames(frames_, reconstruction_);
    for (int image = 0; image < index_.Size(); ++image) {
      const colmap::image_t image_id = index_.IdOf(image);
      if (!reconstruction_->IsImageRegistered(image_id)) continue;
      centers_[image] =
          CamFromWorld(reconstruction_->Image(image_id)).TargetOriginInSource();
    }
  }

  void Rescale(double factor) {
    for (auto& center : centers_) {
      if (center) *center *= factor;
    }
    for (auto& point : points_) {
      if (point) *point *= factor;
    }
    for (auto& observations : observations_) {
      for (Observation& observation : observations) {
        observation.depth *= factor;
      }
    }
  }

  size_t WriteCenters() {
    size_t num_registered = 0;
    for (int image = 0; image < index_.Size(); ++image) {
      if (!centers_[image]) continue;
      const colmap::image_t image_id = index_.IdOf(image);
      SetCenterInWorld(*centers_[image], &reconstruction_->Image(image_id));
      reconstruction_->RegisterImage(image_id);
      ++num_registered;
    }
    return num_registered;
  }

  size_t WriteToReconstruction() {
    const size_t num_registered = WriteCenters();
    observations_ = {};
    for (size_t i = 0; i < tracks_.size(); ++i) {
      if (!points_[i]) continue;
      colmap::Track track;
      for (const colmap::TrackElement& element : tracks_[i].Elements()) {
        if (centers_[index_.Of(element.image_id)]) track.AddElement(element);
      }
      if (track.Length() < 2) continue;
      reconstruction_->AddPoint3D(*points_[i], track);
    }
    return num_registered;
  }

  const ImageIndex& index_;
  const PairGeometries& pairs_;
  const ImageScales scales_;
  const std::vector<colmap::Track>& tracks_;
  const FrameMembers& frames_;
  const AveragedCenters& averaged_centers_;
  // Below it the position of a point along its rays is noise.
  const double min_triangulation_angle_deg_;
  colmap::Reconstruction* reconstruction_;

  std::vector<std::optional<Eigen::Vector3d>> centers_;
  std::vector<std::optional<Eigen::Vector3d>> points_;
  std::vector<std::vector<Observation>> observations_;
  std::vector<std::vector<int>> tracks_of_images_;
  std::vector<int> num_placed_tracks_;
};

}  // namespace

size_t InitializePositions(const ImageIndex& index,
                           const PairGeometries& pairs,
                           const KeypointDepthMap& depths,
                           const ImageScales& scales,
                           const std::vector<colmap::Track>& tracks,
                           const PositionInitializationOptions& options,
                           double min_triangulation_angle_deg,
                           colmap::Reconstruction* reconstruction,
                           const FrameMembers& frames,
                           const AveragedCenters& averaged_centers) {
  return PositionInitializer(index,
                             pairs,
                             depths,
                             scales,
                             tracks,
                             options,
                             min_triangulation_angle_deg,
                             frames,
                             averaged_centers,
                             reconstruction)
      .Run();
}

}  // namespace dgsfm
