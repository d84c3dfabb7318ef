// Normal equations of cameras and points with the points eliminated (Schur
// complement), in contiguous arrays.

#pragma once

#include "colmap_ext/check.h"
#include "colmap_ext/parallel.h"
#include "estimators/optimization/observation_blocks.h"
#include "estimators/optimization/reduced_system.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <tuple>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace dgsfm {

// Residuals r of size kResidual depend on the up to kCamera parameters of one
// camera and on one point. Parameters are mapped to columns of the reduced
// system: cameras may share columns, and a parameter without one (-1) is
// constant. Results are the same for any number of threads: each sum is formed
// by one thread in the order of the observations.
template <int kResidual, int kCamera>
class PointElimination {
 public:
  using CameraColumns = std::array<int, kCamera>;
  // A residual with its derivatives, transposed.
  struct Row {
    Eigen::Matrix<double, kResidual, 1> residual;
    Eigen::Matrix<double, kCamera, kResidual> by_camera;
    Eigen::Matrix<double, 3, kResidual> by_point;
  };

  // The references must outlive this.
  PointElimination(const ObservationIndex& observations,
                   const std::vector<CameraColumns>& camera_columns,
                   int num_threads)
      : observations_(observations),
        columns_(camera_columns),
        num_threads_(num_threads),
        rows_(observations.cameras.size()),
        point_blocks_(observations.num_points),
        camera_blocks_(observations.num_cameras),
        index_(observations),
        blocks_(index_.NumBlocks()) {
    DGSFM_CHECK(columns_.size() == size_t(observations_.num_cameras));
  }

  // To be filled, one an observation.
  std::vector<Row>& Rows() { return rows_; }
  const std::vector<Row>& Rows() const { return rows_; }

  // The observations of a point are contiguous.
  int PointBegin(int point) const { return index_.PointBegin(point); }
  int PointEnd(int point) const { return index_.PointEnd(point); }

  // J^T J and J^T r of a point by its rows.
  std::pair<Eigen::Matrix3d, Eigen::Vector3d> NormalEquations(int point) const {
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (int k = PointBegin(point); k < PointEnd(point); ++k) {
      const Row& row = rows_[k];
      hessian += row.by_point.lazyProduct(row.by_point.transpose());
      gradient += row.by_point.lazyProduct(row.residual);
    }
    return {hessian, gradient};
  }

  // Pairs of columns that the reduced system couples.
  std::vector<std::pair<int, int>> Pattern() const {
    std::vector<std::pair<int, int>> pattern;
    ForEachEntry([&](size_t, int, int, int column1, int column2) {
      pattern.emplace_back(column1, column2);
    });
    return pattern;
  }

  // Looks up where the blocks go; before anything below.
  void Attach(const ReducedSystem& system) {
    targets_.assign(blocks_.size() * kCamera * kCamera, -1);
    doubled_.clear();
    ForEachEntry([&](size_t block, int i, int j, int column1, int column2) {
      const size_t source = block * kCamera * kCamera + j * kCamera + i;
      targets_[source] = system.EntryOf(column1, column2);
      if (column1 == column2 && !index_.IsDiagonal(block))
        doubled_.push_back(source);
    });
  }

  // Sums up J^T J and J^T r of the rows. Adds the diagonal and the gradient of
  // the cameras to vectors over columns.
  void Accumulate(Eigen::VectorXd* diagonal, Eigen::VectorXd* gradient) {
    ParallelChunks(observations_.num_points, [&](int point) {
      PointBlock& block = point_blocks_[point];
      std::tie(block.hessian, block.gradient) = NormalEquations(point);
    });
    index_.ForCameraRanges(num_threads_, [this](int first, int last) {
      AccumulateOf(first, last);
    });
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (int i = 0; i < kCamera; ++i) {
        const int column = columns_[camera][i];
        if (column < 0) continue;
        (*diagonal)(column) += camera_blocks_[camera].hessian(i, i);
        (*gradient)(column) += camera_blocks_[camera].gradient(i);
      }
    }
  }

  // Eliminates the points with their diagonals grown by `damping` of
  // themselves; adds the reduced matrix and right side -J^T r to the system.
  // The diagonals of the cameras are not damped.
  void Eliminate(double damping, ReducedSystem* system, Eigen::VectorXd* rhs) {
    ParallelChunks(observations_.num_points, [&](int point) {
      PointBlock& block = point_blocks_[point];
      Eigen::Matrix3d damped = block.hessian;
      damped.diagonal() += damping * Damped(block.hessian.diagonal());
      block.inverse = damped.llt().solve(Eigen::Matrix3d::Identity());
    });
    index_.ForCameraRanges(num_threads_, [this](int first, int last) {
      EliminateOf(first, last);
    });
    double* values = system->Values();
    for (size_t block = 0; block < blocks_.size(); ++block) {
      const double* source = blocks_[block].data();
      const int64_t* target = &targets_[block * kCamera * kCamera];
      for (int i = 0; i < kCamera * kCamera; ++i) {
        if (target[i] >= 0) values[target[i]] += source[i];
      }
    }
    // Both halves of the matrix meet on its diagonal.
    for (const size_t source : doubled_) {
      values[targets_[source]] += blocks_[source / (kCamera * kCamera)]
                                      .data()[source % (kCamera * kCamera)];
    }
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (int i = 0; i < kCamera; ++i) {
        const int column = columns_[camera][i];
        if (column >= 0) (*rhs)(column) += camera_blocks_[camera].rhs(i);
      }
    }
  }

  // Steps of the points given those of the columns.
  void Substitute(const Eigen::VectorXd& column_steps,
                  std::vector<Eigen::Vector3d>* point_steps) const {
    std::vector<Eigen::Matrix<double, kCamera, 1>> camera_steps(
        observations_.num_cameras);
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (int i = 0; i < kCamera; ++i) {
        const int column = columns_[camera][i];
        camera_steps[camera](i) = column < 0 ? 0 : column_steps(column);
      }
    }
    point_steps->resize(observations_.num_points);
    ParallelChunks(observations_.num_points, [&](int point) {
      const PointBlock& block = point_blocks_[point];
      Eigen::Vector3d gradient = block.gradient;
      for (int k = index_.PointBegin(point); k < index_.PointEnd(point); ++k) {
        const Row& row = rows_[k];
        const Eigen::Matrix<double, kResidual, 1> change =
            row.by_camera.transpose().lazyProduct(
                camera_steps[observations_.cameras[k]]);
        gradient += row.by_point.lazyProduct(change);
      }
      (*point_steps)[point] = -block.inverse.lazyProduct(gradient);
    });
  }

  // Decrease of the linearised cost by the steps of the points, less what the
  // columns share in: (damping D d - g) d / 2.
  double PointDecrease(double damping,
                       const std::vector<Eigen::Vector3d>& steps) const {
    double decrease = 0;
    for (int point = 0; point < observations_.num_points; ++point) {
      const PointBlock& block = point_blocks_[point];
      decrease +=
          0.5 *
          steps[point].dot(
              damping *
                  Damped(block.hessian.diagonal()).cwiseProduct(steps[point]) -
              block.gradient);
    }
    return decrease;
  }

  // What the damping is relative to.
  template <typename Vector>
  static auto Damped(const Vector& diagonal) {
    return diagonal.cwiseMax(kMinDiagonal);
  }

  // Calls function(i) for i in [0, count), on several threads in chunks.
  template <typename Function>
  void ParallelChunks(int count, const Function& function) const {
    const int num_chunks = (count + kChunkSize - 1) / kChunkSize;
    ParallelFor(num_chunks, num_threads_, [&](size_t chunk) {
      const int end = std::min<int>(count, (int(chunk) + 1) * kChunkSize);
      for (int i = int(chunk) * kChunkSize; i < end; ++i) function(i);
    });
  }

 private:
  using CameraVector = Eigen::Matrix<double, kCamera, 1>;
  using CameraMatrix = Eigen::Matrix<double, kCamera, kCamera>;

  static constexpr double kMinDiagonal = 1e-12;
  static constexpr int kChunkSize = 1000;

  struct PointBlock {
    Eigen::Matrix3d hessian;
    Eigen::Matrix3d inverse;
    Eigen::Vector3d gradient;
  };
  struct CameraBlock {
    CameraMatrix hessian;
    CameraVector gradient;
    CameraVector rhs;
  };
  void AccumulateOf(int first_camera, int last_camera) {
    for (int camera = first_camera; camera < last_camera; ++camera) {
      camera_blocks_[camera].hessian.setZero();
      camera_blocks_[camera].gradient.setZero();
    }
    for (size_t k = 0; k < rows_.size(); ++k) {
      const int camera = observations_.cameras[k];
      if (camera < first_camera || camera >= last_camera) continue;
      CameraBlock& block = camera_blocks_[camera];
      const Row& row = rows_[k];
      block.hessian += row.by_camera.lazyProduct(row.by_camera.transpose());
      block.gradient += row.by_camera.lazyProduct(row.residual);
    }
  }

  // Calls function(block, i, j, column_i, column_j) for the entries of all
  // blocks that count: of those on the diagonal one half.
  template <typename Function>
  void ForEachEntry(const Function& function) const {
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (size_t b = index_.BlockBegin(camera); b < index_.BlockEnd(camera);
           ++b) {
        const int other = index_.OtherCamera(b);
        for (int j = 0; j < kCamera; ++j) {
          const int num_rows = other == camera ? j + 1 : kCamera;
          for (int i = 0; i < num_rows; ++i) {
            const int column1 = columns_[camera][i];
            const int column2 = columns_[other][j];
            if (column1 >= 0 && column2 >= 0) {
              function(b, i, j, column1, column2);
            }
          }
        }
      }
    }
  }

  // The blocks of cameras and their part of the right side.
  void EliminateOf(int first_camera, int last_camera) {
    for (int camera = first_camera; camera < last_camera; ++camera) {
      const size_t begin = index_.BlockBegin(camera);
      for (size_t b = begin; b < index_.BlockEnd(camera); ++b) {
        blocks_[b].setZero();
      }
      blocks_[begin] = camera_blocks_[camera].hessian;
      camera_blocks_[camera].rhs = -camera_blocks_[camera].gradient;
    }
    for (int k = 0; k < int(rows_.size()); ++k) {
      const int camera = observations_.cameras[k];
      if (camera < first_camera || camera >= last_camera) continue;
      const Row& row = rows_[k];
      const PointBlock& point_block = point_blocks_[observations_.points[k]];
      const Eigen::Matrix<double, kResidual, 3> projected =
          row.by_point.transpose().lazyProduct(point_block.inverse);
      const Eigen::Matrix<double, kResidual, 1> shift =
          projected.lazyProduct(point_block.gradient);
      camera_blocks_[camera].rhs += row.by_camera.lazyProduct(shift);
      const int* pair_blocks = index_.BlocksFrom(k);
      for (int i = 0; i < index_.NumPairsFrom(k); ++i) {
        const Row& other_row = rows_[k + i];
        const Eigen::Matrix<double, kResidual, kResidual> core =
            projected.lazyProduct(other_row.by_point);
        const Eigen::Matrix<double, kCamera, kResidual> right =
            other_row.by_camera.lazyProduct(core.transpose());
        CameraMatrix& block = blocks_[pair_blocks[i]];
        block -= row.by_camera.lazyProduct(right.transpose());
        // Twice in the track of one point.
        if (i > 0 && observations_.cameras[k + i] == camera) {
          block -= right.lazyProduct(row.by_camera.transpose());
        }
      }
    }
  }

  const ObservationIndex& observations_;
  const std::vector<CameraColumns>& columns_;
  const int num_threads_;
  std::vector<Row> rows_;
  std::vector<PointBlock> point_blocks_;
  std::vector<CameraBlock> camera_blocks_;
  const ObservationBlocks index_;
  std::vector<CameraMatrix> blocks_;
  // Entry of the reduced system of each entry of the blocks, or -1.
  std::vector<int64_t> targets_;
  std::vector<size_t> doubled_;
};

}  // namespace dgsfm
