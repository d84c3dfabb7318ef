#include "estimators/optimization/curved_step.h"

#include "colmap_ext/parallel.h"
#include "estimators/averaging/graph.h"
#include "estimators/rotation_vector.h"

#include <algorithm>
#include <map>
#include <utility>

namespace dgsfm {

namespace {

// Where a body with this motion takes what is at `offset` from its center and
// moves by `step`, relative to its new center.
Eigen::Vector3d Carry(const BodyMotion& motion,
                      const Eigen::Quaterniond& turn,
                      const Eigen::Vector3d& offset,
                      const Eigen::Vector3d& step) {
  return turn *
         (offset + step - motion.translation - motion.rotation.cross(offset));
}

}  // namespace

CurvedStep::CurvedStep(ObservationIndex observations, int held_body)
    : observations_(std::move(observations)),
      held_body_(held_body),
      ranges_(observations_),
      links_(FindLinks(observations_)),
      laplacian_(observations_.num_cameras, [this](const auto& couple) {
        for (const Link& link : links_) couple(link.body1, link.body2);
      }) {
  std::vector<GraphEdge> edges;
  for (const Link& link : links_) edges.emplace_back(link.body1, link.body2);
  const std::vector<int> parts =
      ConnectedComponents(observations_.num_cameras, edges);
  held_bodies_.assign(
      parts.empty() ? 0 : *std::max_element(parts.begin(), parts.end()) + 1,
      -1);
  held_bodies_[parts[held_body]] = held_body;
  for (size_t body = 0; body < parts.size(); ++body) {
    int& held = held_bodies_[parts[body]];
    if (held < 0) held = int(body);
  }
}

std::vector<CurvedStep::Link> CurvedStep::FindLinks(
    const ObservationIndex& observations) {
  std::map<std::pair<int, int>, int> counts;
  const std::vector<int>& bodies = observations.cameras;
  for (size_t k = 1; k < bodies.size(); ++k) {
    if (observations.points[k] != observations.points[k - 1] ||
        bodies[k] == bodies[k - 1]) {
      continue;
    }
    ++counts[std::minmax(bodies[k], bodies[k - 1])];
  }
  std::vector<Link> links;
  for (const auto& [bodies_of_link, count] : counts) {
    links.push_back({bodies_of_link.first, bodies_of_link.second, 1.0 * count});
  }
  return links;
}

void CurvedStep::AddToLaplacian(int body1, int body2, double value) {
  laplacian_.Values()[laplacian_.EntryOf(body1, body2)] += value;
}

std::optional<std::vector<Eigen::Vector3d>> CurvedStep::MoveCenters(
    const std::vector<BodyMotion>& motions) {
  laplacian_.SetZero();
  Eigen::MatrixXd right_side = Eigen::MatrixXd::Zero(motions.size(), 3);
  for (const auto& [body1, body2, weight] : links_) {
    const BodyMotion& motion1 = motions[body1];
    const BodyMotion& motion2 = motions[body2];
    BodyMotion mean;
    mean.rotation = (motion1.rotation + motion2.rotation) / 2;
    mean.translation = motion1.translation;
    const Eigen::Vector3d offset = motion2.center - motion1.center;
    const Eigen::Vector3d curved = Carry(
        mean, RotationFromVector(mean.rotation), offset, motion2.translation);
    const Eigen::Vector3d straight =
        offset + motion2.translation - motion1.translation;
    const Eigen::RowVector3d change = weight * (curved - straight).transpose();
    right_side.row(body1) -= change;
    right_side.row(body2) += change;
    AddToLaplacian(body1, body1, weight);
    AddToLaplacian(body2, body2, weight);
    AddToLaplacian(body1, body2, -weight);
  }
  // The sum of all rows leaves a spring alone: it rests, whatever its strength.
  for (const int body : held_bodies_) AddToLaplacian(body, body, 1);
  Eigen::MatrixXd changes;
  if (!laplacian_.Solve(right_side, &changes)) return std::nullopt;
  std::vector<Eigen::Vector3d> centers;
  for (size_t i = 0; i < motions.size(); ++i) {
    centers.push_back(motions[i].center + motions[i].translation +
                      changes.row(Eigen::Index(i)).transpose());
  }
  return centers;
}

std::optional<CurvedPositions> CurvedStep::Move(
    const std::vector<BodyMotion>& motions,
    const std::vector<Eigen::Vector3d>& points,
    const std::vector<Eigen::Vector3d>& point_steps,
    int num_threads) {
  std::optional<std::vector<Eigen::Vector3d>> centers = MoveCenters(motions);
  if (!centers) return std::nullopt;
  std::vector<Eigen::Quaterniond> turns;
  for (const BodyMotion& motion : motions) {
    turns.push_back(RotationFromVector(motion.rotation));
  }
  CurvedPositions positions = {std::move(*centers), points};
  ParallelFor(points.size(), num_threads, [&](size_t i) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    double sum_of_weights = 0;
    for (int k = ranges_.Begin(int(i)); k < ranges_.End(int(i)); ++k) {
      const int body = observations_.cameras[k];
      const Eigen::Vector3d offset = points[i] - motions[body].center;
      const double weight = 1 / offset.squaredNorm();
      sum +=
          weight * (positions.centers[body] +
                    Carry(motions[body], turns[body], offset, point_steps[i]));
      sum_of_weights += weight;
    }
    positions.points[i] = sum_of_weights > 0
                              ? Eigen::Vector3d(sum / sum_of_weights)
                              : Eigen::Vector3d(points[i] + point_steps[i]);
  });
  return positions;
}

}  // namespace dgsfm
