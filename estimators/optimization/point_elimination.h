// Normal equations of cameras and points with the points eliminated (Schur
// complement), in contiguous arrays.

#pragma once

#include "colmap_ext/check.h"
#include "colmap_ext/parallel.h"
#include "estimators/lanes.h"
#include "estimators/optimization/observation_blocks.h"
#include "estimators/optimization/reduced_system.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <tuple>
#include <utility>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>

namespace dgsfm {

// Residuals r of size kResidual depend on the up to kCamera parameters of one
// camera and on one point. Parameters are mapped to columns of the reduced
// system: cameras may share columns, and a parameter without one (-1) is
// constant. Rows are computed when they are needed, for some thousand
// observations at a time, so that caches hold them: all of them would be the
// largest part of the memory. Results are the same for any number of threads:
// each sum is formed by one thread in the order of the observations.
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
  // Computes the row of an observation; called by several threads.
  using Linearizer = std::function<void(int observation, Row* row)>;
  // Takes a point and its rows, and may move the point and compute the rows
  // anew; called by several threads.
  using PointVisitor = std::function<void(int point, Row* rows)>;

  // The references must outlive this.
  PointElimination(const ObservationIndex& observations,
                   const std::vector<CameraColumns>& camera_columns,
                   Linearizer linearizer,
                   int num_threads)
      : observations_(observations),
        columns_(camera_columns),
        linearizer_(std::move(linearizer)),
        num_threads_(EffectiveNumThreads(num_threads)),
        point_blocks_(observations.num_points),
        camera_blocks_(observations.num_cameras),
        index_(observations),
        blocks_(index_.NumBlocks()) {
    DGSFM_CHECK(columns_.size() == size_t(observations_.num_cameras));
  }

  // The observations of a point are contiguous.
  int PointBegin(int point) const { return index_.PointBegin(point); }
  int PointEnd(int point) const { return index_.PointEnd(point); }

  // J^T J and J^T r of a point by its rows.
  std::pair<Eigen::Matrix3d, Eigen::Vector3d> NormalEquations(
      int point, const Row* rows) const {
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (int i = 0; i < PointEnd(point) - PointBegin(point); ++i) {
      hessian += rows[i].by_point.lazyProduct(rows[i].by_point.transpose());
      gradient += rows[i].by_point.lazyProduct(rows[i].residual);
    }
    return {hessian, gradient};
  }

  // Calls function(column1, column2) for the pairs of columns that the reduced
  // system couples, some of them several times.
  template <typename Function>
  void ForEachCoupling(const Function& function) const {
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (size_t b = index_.BlockBegin(camera); b < index_.BlockEnd(camera);
           ++b) {
        for (const int column2 : columns_[index_.OtherCamera(b)]) {
          for (const int column1 : columns_[camera]) {
            if (column1 >= 0 && column2 >= 0) function(column1, column2);
          }
        }
      }
    }
  }

  // Sums up J^T J and J^T r of the rows, after a visit of each point. Adds the
  // diagonal and the gradient of the cameras to vectors over columns.
  void Accumulate(const PointVisitor& visitor,
                  Eigen::VectorXd* diagonal,
                  Eigen::VectorXd* gradient) {
    for (CameraBlock& block : camera_blocks_) {
      block.hessian.setZero();
      block.gradient.setZero();
    }
    ForEachChunk(
        [&](int point, Row* rows) {
          if (visitor) visitor(point, rows);
          PointBlock& block = point_blocks_[point];
          std::tie(block.hessian, block.gradient) =
              NormalEquations(point, rows);
        },
        [&](const int* begin, const int* end) {
          for (const int* k = begin; k != end; ++k) {
            const Row& row = RowOf(*k);
            CameraBlock& block = camera_blocks_[observations_.cameras[*k]];
            block.hessian +=
                row.by_camera.lazyProduct(row.by_camera.transpose());
            block.gradient += row.by_camera.lazyProduct(row.residual);
          }
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
    for (auto& block : blocks_) block.setZero();
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      CameraBlock& block = camera_blocks_[camera];
      blocks_[index_.BlockBegin(camera)] = block.hessian;
      block.rhs = -block.gradient;
    }
    ForEachChunk(
        [&](int point, Row*) {
          PointBlock& block = point_blocks_[point];
          Eigen::Matrix3d damped = block.hessian;
          damped.diagonal() += damping * Damped(block.hessian.diagonal());
          block.inverse = damped.llt().solve(Eigen::Matrix3d::Identity());
        },
        [&](const int* begin, const int* end) { EliminateOf(begin, end); });
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      AddBlocksOf(camera, system);
    }
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      AddSharedColumnsOf(camera, system);
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
    ForPoints(0, observations_.num_points, [&](int point) {
      const PointBlock& block = point_blocks_[point];
      Eigen::Vector3d gradient = block.gradient;
      Row row;
      for (int k = index_.PointBegin(point); k < index_.PointEnd(point); ++k) {
        linearizer_(k, &row);
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

 private:
  using CameraVector = Eigen::Matrix<double, kCamera, 1>;
  using CameraMatrix = Eigen::Matrix<double, kCamera, kCamera>;

  static constexpr double kMinDiagonal = 1e-12;
  // Observations whose rows are computed at a time, or those of one point, and
  // points that a thread goes through at a time.
  static constexpr int kChunkSize = 16384;
  static constexpr int kNumPointsPerItem = 100;

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

  const Row& RowOf(int k) const { return rows_[k - first_row_]; }

  template <typename Function>
  void ForPoints(int first, int last, const Function& function) const {
    const int num_items =
        (last - first + kNumPointsPerItem - 1) / kNumPointsPerItem;
    ParallelFor(num_items, num_threads_, [&](size_t item) {
      const int begin = first + int(item) * kNumPointsPerItem;
      const int end = std::min(last, begin + kNumPointsPerItem);
      for (int point = begin; point < end; ++point) function(point);
    });
  }

  // Goes through the points chunk by chunk: computes the rows of a chunk, calls
  // visit(point, rows) for its points, and then reduce(begin, end) for lists of
  // its observations, those of one camera in one list and in their order.
  template <typename Visit, typename Reduce>
  void ForEachChunk(const Visit& visit, const Reduce& reduce) {
    for (int first = 0; first < observations_.num_points;) {
      first_row_ = PointBegin(first);
      int last = first + 1;
      while (last < observations_.num_points &&
             PointEnd(last) - first_row_ <= kChunkSize) {
        ++last;
      }
      if (rows_.size() < size_t(PointBegin(last) - first_row_)) {
        rows_.resize(PointBegin(last) - first_row_);
      }
      ForPoints(first, last, [&](int point) {
        Row* rows = &rows_[PointBegin(point) - first_row_];
        for (int k = PointBegin(point); k < PointEnd(point); ++k) {
          linearizer_(k, &rows[k - PointBegin(point)]);
        }
        visit(point, rows);
      });
      const ChunkByCamera by_camera(
          index_, observations_, first, last, num_threads_);
      ParallelFor(by_camera.NumRanges(), num_threads_, [&](size_t range) {
        reduce(by_camera.Begin(range), by_camera.End(range));
      });
      first = last;
    }
  }

  // block -= left right^T, in loops that the compiler vectorises for the
  // processor at hand.
  static DGSFM_INLINE void SubtractProduct(const double* left,
                                           const double* right,
                                           double* block) {
    for (int column = 0; column < kCamera; ++column) {
      for (int row = 0; row < kCamera; ++row) {
        double sum = 0;
        for (int r = 0; r < kResidual; ++r) {
          sum += left[r * kCamera + row] * right[r * kCamera + column];
        }
        block[column * kCamera + row] -= sum;
      }
    }
  }

  // The blocks of cameras and their part of the right side.
  DGSFM_TARGET_CLONES
  void EliminateOf(const int* begin, const int* end) {
    std::vector<CameraMatrix*> blocks(observations_.num_cameras);
    int last_camera = -1;
    for (const int* next = begin; next != end; ++next) {
      const int k = *next;
      const int camera = observations_.cameras[k];
      if (camera != last_camera) {
        for (size_t b = index_.BlockBegin(camera); b < index_.BlockEnd(camera);
             ++b) {
          blocks[index_.OtherCamera(b)] = &blocks_[b];
        }
        last_camera = camera;
      }
      const Row& row = RowOf(k);
      const PointBlock& point_block = point_blocks_[observations_.points[k]];
      const Eigen::Matrix<double, kResidual, 3> projected =
          row.by_point.transpose().lazyProduct(point_block.inverse);
      const Eigen::Matrix<double, kResidual, 1> shift =
          projected.lazyProduct(point_block.gradient);
      camera_blocks_[camera].rhs += row.by_camera.lazyProduct(shift);
      for (int i = 0; i < index_.NumPairsFrom(k); ++i) {
        const int other_camera = observations_.cameras[k + i];
        const Row& other_row = RowOf(k + i);
        const Eigen::Matrix<double, kResidual, kResidual> core =
            projected.lazyProduct(other_row.by_point);
        Eigen::Matrix<double, kCamera, kResidual> right;
        for (int r = 0; r < kResidual; ++r) {
          for (int c = 0; c < kCamera; ++c) {
            double sum = 0;
            for (int q = 0; q < kResidual; ++q) {
              sum += other_row.by_camera.data()[q * kCamera + c] * core(r, q);
            }
            right.data()[r * kCamera + c] = sum;
          }
        }
        CameraMatrix& block = *blocks[other_camera];
        SubtractProduct(row.by_camera.data(), right.data(), block.data());
        // Twice in the track of one point.
        if (i > 0 && other_camera == camera) {
          SubtractProduct(right.data(), row.by_camera.data(), block.data());
        }
      }
    }
  }

  // Blocks on the diagonal count with one half.
  void AddBlocksOf(int camera, ReducedSystem* system) const {
    for (size_t b = index_.BlockBegin(camera); b < index_.BlockEnd(camera);
         ++b) {
      const int other = index_.OtherCamera(b);
      system->AddBlock(columns_[camera].data(),
                       columns_[other].data(),
                       kCamera,
                       camera == other,
                       blocks_[b].data());
    }
  }

  // Both halves of the matrix meet on its diagonal.
  void AddSharedColumnsOf(int camera, ReducedSystem* system) const {
    for (size_t b = index_.BlockBegin(camera) + 1; b < index_.BlockEnd(camera);
         ++b) {
      const CameraColumns& others = columns_[index_.OtherCamera(b)];
      for (int j = 0; j < kCamera; ++j) {
        for (int i = 0; i < kCamera; ++i) {
          const int column = columns_[camera][i];
          if (column < 0 || column != others[j]) continue;
          system->Values()[system->EntryOf(column, column)] += blocks_[b](i, j);
        }
      }
    }
  }

  const ObservationIndex& observations_;
  const std::vector<CameraColumns>& columns_;
  const Linearizer linearizer_;
  const int num_threads_;
  // Index of the observation of the first row held.
  std::vector<Row> rows_;
  int first_row_ = 0;
  std::vector<PointBlock> point_blocks_;
  std::vector<CameraBlock> camera_blocks_;
  const ObservationBlocks index_;
  std::vector<CameraMatrix> blocks_;
};

}  // namespace dgsfm
