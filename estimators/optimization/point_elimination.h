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
#include <cstdint>
#include <functional>
#include <optional>
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
  using CameraVector = Eigen::Matrix<double, kCamera, 1>;
  using CameraMatrix = Eigen::Matrix<double, kCamera, kCamera>;
  // A residual with its derivatives, transposed.
  struct Row {
    Eigen::Matrix<double, kResidual, 1> residual;
    Eigen::Matrix<double, kCamera, kResidual> by_camera;
    Eigen::Matrix<double, 3, kResidual> by_point;
  };
  struct PointBlock {
    Eigen::Matrix3d hessian;
    Eigen::Matrix3d inverse;
    Eigen::Vector3d gradient;
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
        ranges_(observations),
        point_blocks_(observations.num_points),
        camera_blocks_(observations.num_cameras) {
    DGSFM_CHECK(columns_.size() == size_t(observations_.num_cameras));
    DivideColumns();
  }

  const ObservationIndex& Observations() const { return observations_; }
  const std::vector<CameraColumns>& Columns() const { return columns_; }
  int NumThreads() const { return num_threads_; }

  // The observations of a point are contiguous.
  int PointBegin(int point) const { return ranges_.Begin(point); }
  int PointEnd(int point) const { return ranges_.End(point); }

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

  // Blocks of the reduced matrix, which are listed when they are first asked
  // for.
  const ObservationBlocks& Blocks() {
    if (!index_) index_.emplace(observations_, ranges_);
    return *index_;
  }
  void ReleaseBlocks() { index_.reset(); }

  // Calls function(column1, column2) for the pairs of columns that the reduced
  // system couples, some of them several times.
  template <typename Function>
  void ForEachCoupling(const Function& function) {
    const ObservationBlocks& index = Blocks();
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (size_t b = index.BlockBegin(camera); b < index.BlockEnd(camera);
           ++b) {
        for (const int column2 : columns_[index.OtherCamera(b)]) {
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
    blocks_.assign(Blocks().NumBlocks(), CameraMatrix::Zero());
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      CameraBlock& block = camera_blocks_[camera];
      blocks_[index_->BlockBegin(camera)] = block.hessian;
      block.rhs = -block.gradient;
    }
    ForEachChunk(
        [&](int point, Row*) {
          Invert(point_blocks_[point].hessian, damping, point);
        },
        [&](const int* begin, const int* end) { EliminateOf(begin, end); });
    ParallelFor(size_t(observations_.num_cameras), num_threads_, [&](size_t i) {
      AddBlocksOf(int(i), system);
    });
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      AddSharedEntriesOf(camera, system);
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
      for (int k = ranges_.Begin(point); k < ranges_.End(point); ++k) {
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
          observations_, ranges_, first, last, num_threads_);
      ParallelFor(by_camera.NumRanges(), num_threads_, [&](size_t range) {
        reduce(by_camera.Begin(range), by_camera.End(range));
      });
      first = last;
    }
  }

  const Row& RowOf(int k) const { return rows_[k - first_row_]; }

  // Holds the inverse of J^T J of a point, damped.
  void Invert(Eigen::Matrix3d hessian, double damping, int point) {
    PointBlock& block = point_blocks_[point];
    hessian.diagonal() += damping * Damped(block.hessian.diagonal());
    block.inverse = hessian.llt().solve(Eigen::Matrix3d::Identity());
  }

  const PointBlock& Point(int point) const { return point_blocks_[point]; }
  const CameraMatrix& CameraHessian(int camera) const {
    return camera_blocks_[camera].hessian;
  }
  const CameraVector& CameraGradient(int camera) const {
    return camera_blocks_[camera].gradient;
  }

 private:
  struct CameraBlock {
    CameraMatrix hessian;
    CameraVector gradient;
    CameraVector rhs;
  };

  static constexpr double kMinDiagonal = 1e-12;
  // Observations whose rows are computed at a time, or those of one point, and
  // points that a thread goes through at a time.
  static constexpr int kChunkSize = 16384;
  static constexpr int kNumPointsPerItem = 100;

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
        for (size_t b = index_->BlockBegin(camera);
             b < index_->BlockEnd(camera);
             ++b) {
          blocks[index_->OtherCamera(b)] = &blocks_[b];
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
      for (int i = 0; i < ranges_.NumPairsFrom(k); ++i) {
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

  // Separates the columns of one camera alone, whose entries no two blocks have
  // in common, from the others; -1 = none.
  void DivideColumns() {
    std::vector<int> owners;
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (const int column : columns_[camera]) {
        if (column < 0) continue;
        if (column >= int(owners.size())) owners.resize(column + 1, -1);
        owners[column] =
            owners[column] < 0 ? camera : observations_.num_cameras;
      }
    }
    for (const CameraColumns& columns : columns_) {
      own_columns_.push_back(columns);
      shared_columns_.push_back(columns);
      has_shared_columns_.push_back(false);
      for (int i = 0; i < kCamera; ++i) {
        if (columns[i] < 0) continue;
        const bool is_shared = owners[columns[i]] == observations_.num_cameras;
        (is_shared ? own_columns_ : shared_columns_).back()[i] = -1;
        if (is_shared) has_shared_columns_.back() = true;
      }
    }
  }

  // Blocks on the diagonal count with one half.
  void AddBlocksOf(int camera, ReducedSystem* system) const {
    for (size_t b = index_->BlockBegin(camera); b < index_->BlockEnd(camera);
         ++b) {
      AddBlock(camera, b, own_columns_, own_columns_, system);
    }
  }

  // Adds the entries of columns that several cameras have.
  void AddSharedEntriesOf(int camera, ReducedSystem* system) const {
    for (size_t b = index_->BlockBegin(camera); b < index_->BlockEnd(camera);
         ++b) {
      if (has_shared_columns_[index_->OtherCamera(b)]) {
        AddBlock(camera, b, own_columns_, shared_columns_, system);
      }
      if (has_shared_columns_[camera]) {
        AddBlock(camera, b, shared_columns_, columns_, system);
      }
    }
  }

  void AddBlock(int camera,
                size_t b,
                const std::vector<CameraColumns>& columns,
                const std::vector<CameraColumns>& other_columns,
                ReducedSystem* system) const {
    const int other = index_->OtherCamera(b);
    system->AddBlock(columns[camera].data(),
                     other_columns[other].data(),
                     kCamera,
                     camera == other,
                     blocks_[b].data());
  }

  // Both halves of the matrix meet on its diagonal.
  void AddSharedColumnsOf(int camera, ReducedSystem* system) const {
    if (!has_shared_columns_[camera]) return;
    for (size_t b = index_->BlockBegin(camera) + 1;
         b < index_->BlockEnd(camera);
         ++b) {
      const CameraColumns& others = columns_[index_->OtherCamera(b)];
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
  std::vector<CameraColumns> own_columns_;
  std::vector<CameraColumns> shared_columns_;
  std::vector<bool> has_shared_columns_;
  const Linearizer linearizer_;
  const int num_threads_;
  const PointRanges ranges_;
  // Index of the observation of the first row held.
  std::vector<Row> rows_;
  int first_row_ = 0;
  std::vector<PointBlock> point_blocks_;
  std::vector<CameraBlock> camera_blocks_;
  std::optional<ObservationBlocks> index_;
  std::vector<CameraMatrix> blocks_;
};

}  // namespace dgsfm
