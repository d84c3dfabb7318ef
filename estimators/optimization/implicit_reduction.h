// Solves reduced camera systems that are too full to be formed.

#pragma once

#include "colmap_ext/parallel.h"
#include "estimators/optimization/column_order.h"
#include "estimators/optimization/conjugate_gradients.h"
#include "estimators/optimization/point_elimination.h"

#include <algorithm>
#include <array>
#include <vector>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/SparseCore>

namespace dgsfm {

// The matrix that PointElimination would add to a ReducedSystem is multiplied
// by a vector from the rows, observation by observation, as in Ceres's
// ITERATIVE_SCHUR. Its memory grows with the observations, not with the pairs
// of cameras that share points. Rows are held in single precision: the matrix
// is that of slightly different derivatives and stays positive semidefinite.
// The same for any number of threads.
template <int kResidual, int kCamera>
class ImplicitReduction {
 public:
  using Elimination = PointElimination<kResidual, kCamera>;
  using CameraColumns = typename Elimination::CameraColumns;
  using Triplets = std::vector<Eigen::Triplet<double>>;

  // The arguments must outlive this.
  ImplicitReduction(const ColumnGroups& groups, Elimination* elimination)
      : groups_(groups),
        elimination_(elimination),
        observations_(elimination->Observations()),
        columns_(elimination->Columns()),
        num_columns_(int(groups.group_of_column.size())),
        rows_(observations_.cameras.size()),
        blocks_(observations_.num_cameras),
        place_in_group_(num_columns_),
        group_factors_(groups.columns.size()) {
    for (const std::vector<int>& columns : groups.columns) {
      for (size_t i = 0; i < columns.size(); ++i) {
        place_in_group_[columns[i]] = int(i);
      }
    }
    DividePoints();
  }

  // Eliminates the points with their diagonals grown by `damping` of
  // themselves, and adds to the right side.
  void Form(double damping, Eigen::VectorXd* rhs) {
    std::vector<CameraVector> camera_rhs(observations_.num_cameras);
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      camera_rhs[camera] = -elimination_->CameraGradient(camera);
      blocks_[camera].setZero();
      blocks_[camera].diagonal() =
          kBlockDamping * elimination_->CameraHessian(camera).diagonal();
    }
    elimination_->ForEachChunk(
        [&](int point, typename Elimination::Row* rows) {
          Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
          const int begin = elimination_->PointBegin(point);
          for (int k = begin; k < elimination_->PointEnd(point); ++k) {
            rows_[k].by_camera =
                rows[k - begin].by_camera.template cast<float>();
            rows_[k].by_point = rows[k - begin].by_point.template cast<float>();
            const ByPoint by_point = rows_[k].by_point.template cast<double>();
            hessian += by_point.lazyProduct(by_point.transpose());
          }
          elimination_->Invert(hessian, damping, point);
        },
        [&](const int* begin, const int* end) {
          for (const int* k = begin; k != end; ++k) {
            AddObservation(*k, &camera_rhs[observations_.cameras[*k]]);
          }
        });
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (int i = 0; i < kCamera; ++i) {
        const int column = columns_[camera][i];
        if (column >= 0) (*rhs)(column) += camera_rhs[camera](i);
      }
    }
  }

  // Solves by conjugate gradients, with terms of the columns (their lower
  // triangle) and a diagonal added to the matrix. False, with an approximation,
  // if that takes more than max_num_iterations.
  [[nodiscard]] bool Solve(int max_num_iterations,
                           const Eigen::VectorXd& diagonal,
                           const Triplets& terms,
                           const Eigen::VectorXd& rhs,
                           Eigen::VectorXd* solution) {
    Eigen::VectorXd full_diagonal = diagonal;
    Eigen::SparseMatrix<double> term_matrix(num_columns_, num_columns_);
    term_matrix.setFromTriplets(terms.begin(), terms.end());
    full_diagonal += term_matrix.diagonal();
    FactorizePreconditioner(full_diagonal);
    return SolveByConjugateGradients(
        max_num_iterations,
        [&](const Eigen::VectorXd& x) {
          Eigen::VectorXd product = Product(x);
          product += diagonal.cwiseProduct(x);
          product += term_matrix.template selfadjointView<Eigen::Lower>() * x;
          return product;
        },
        [&](const Eigen::VectorXd& x) { return Precondition(x); },
        rhs,
        solution);
  }

 private:
  using CameraVector = typename Elimination::CameraVector;
  using CameraMatrix = typename Elimination::CameraMatrix;
  using ByCamera = Eigen::Matrix<double, kCamera, kResidual>;
  using ByPoint = Eigen::Matrix<double, 3, kResidual>;
  using GroupMatrix = Eigen::
      Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kCamera, kCamera>;
  using GroupVector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kCamera, 1>;

  struct FloatRow {
    Eigen::Matrix<float, kCamera, kResidual> by_camera;
    Eigen::Matrix<float, 3, kResidual> by_point;
  };

  // What is added to the blocks of the preconditioner, relative to the diagonal
  // before the points are eliminated: rounding makes differences negative.
  static constexpr double kBlockDamping = 1e-6;
  // Ranges of points whose products are summed separately.
  static constexpr int kNumParts = 16;

  // All parts have about as many observations.
  void DividePoints() {
    part_begin_.push_back(0);
    const size_t count = observations_.cameras.size();
    for (int point = 0; point < observations_.num_points; ++point) {
      if (size_t(elimination_->PointBegin(point)) * kNumParts >=
          count * part_begin_.size()) {
        part_begin_.push_back(point);
      }
    }
    part_begin_.push_back(observations_.num_points);
  }

  // Adds to the right side and the diagonal block of the observation's camera.
  void AddObservation(int k, CameraVector* rhs) {
    const auto& point = elimination_->Point(observations_.points[k]);
    const ByCamera by_camera = rows_[k].by_camera.template cast<double>();
    const ByPoint by_point = rows_[k].by_point.template cast<double>();
    const Eigen::Matrix<double, kResidual, 3> projected =
        by_point.transpose().lazyProduct(point.inverse);
    const Eigen::Matrix<double, kResidual, 1> shift =
        projected.lazyProduct(point.gradient);
    *rhs += by_camera.lazyProduct(shift);
    Eigen::Matrix<double, kResidual, kResidual> core =
        -projected.lazyProduct(by_point);
    core.diagonal().array() += 1;
    const ByCamera left = by_camera.lazyProduct(core);
    blocks_[observations_.cameras[k]] +=
        left.lazyProduct(by_camera.transpose());
  }

  // Columns of a group belong to the same cameras, and are as many as one has
  // at most.
  bool HasBlock(size_t group) const {
    return groups_.columns[group].size() <= size_t(kCamera);
  }

  // Block Jacobi: a block for each group of columns; those that no camera has
  // are by themselves. The coupling of different cameras by the reduced matrix
  // is left out, so that blocks are positive definite.
  void FactorizePreconditioner(const Eigen::VectorXd& diagonal) {
    std::vector<GroupMatrix> matrices(groups_.columns.size());
    for (size_t group = 0; group < matrices.size(); ++group) {
      if (!HasBlock(group)) continue;
      const auto& columns = groups_.columns[group];
      matrices[group].setZero(columns.size(), columns.size());
      for (size_t i = 0; i < columns.size(); ++i) {
        matrices[group](i, i) = diagonal(columns[i]);
      }
    }
    inverse_diagonal_ = diagonal;
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      AddToGroups(camera, &matrices);
    }
    inverse_diagonal_ = inverse_diagonal_.cwiseInverse();
    for (size_t group = 0; group < matrices.size(); ++group) {
      if (HasBlock(group)) group_factors_[group].compute(matrices[group]);
    }
  }

  void AddToGroups(int camera, std::vector<GroupMatrix>* matrices) {
    for (int j = 0; j < kCamera; ++j) {
      const int column2 = columns_[camera][j];
      if (column2 < 0) continue;
      inverse_diagonal_(column2) += blocks_[camera](j, j);
      const int group = groups_.group_of_column[column2];
      for (int i = 0; i < kCamera; ++i) {
        const int column1 = columns_[camera][i];
        if (column1 < 0 || groups_.group_of_column[column1] != group) continue;
        (*matrices)[group](place_in_group_[column1],
                           place_in_group_[column2]) += blocks_[camera](i, j);
      }
    }
  }

  Eigen::VectorXd Precondition(const Eigen::VectorXd& x) const {
    Eigen::VectorXd result = inverse_diagonal_.cwiseProduct(x);
    for (size_t group = 0; group < group_factors_.size(); ++group) {
      if (!HasBlock(group) || group_factors_[group].info() != Eigen::Success) {
        continue;
      }
      const std::vector<int>& columns = groups_.columns[group];
      GroupVector part(columns.size());
      for (size_t i = 0; i < columns.size(); ++i) part(i) = x(columns[i]);
      group_factors_[group].solveInPlace(part);
      for (size_t i = 0; i < columns.size(); ++i) result(columns[i]) = part(i);
    }
    return result;
  }

  Eigen::VectorXd Product(const Eigen::VectorXd& x) {
    std::vector<CameraVector> by_camera(observations_.num_cameras);
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      for (int i = 0; i < kCamera; ++i) {
        const int column = columns_[camera][i];
        by_camera[camera](i) = column < 0 ? 0 : x(column);
      }
    }
    const size_t num_parts = part_begin_.size() - 1;
    products_.resize(num_parts);
    ParallelFor(num_parts, elimination_->NumThreads(), [&](size_t part) {
      products_[part].assign(observations_.num_cameras, CameraVector::Zero());
      AddProduct(part_begin_[part],
                 part_begin_[part + 1],
                 by_camera,
                 &products_[part]);
    });
    Eigen::VectorXd product = Eigen::VectorXd::Zero(num_columns_);
    for (int camera = 0; camera < observations_.num_cameras; ++camera) {
      CameraVector sum = CameraVector::Zero();
      for (const auto& part : products_) sum += part[camera];
      for (int i = 0; i < kCamera; ++i) {
        const int column = columns_[camera][i];
        if (column >= 0) product(column) += sum(i);
      }
    }
    return product;
  }

  // J_c^T (J_c x - J_p (J_p^T J_p)^-1 J_p^T J_c x) of a range of points.
  DGSFM_TARGET_CLONES
  void AddProduct(int begin_point,
                  int end_point,
                  const std::vector<CameraVector>& x,
                  std::vector<CameraVector>* product) const {
    std::vector<std::array<double, kResidual>> changes;
    for (int point = begin_point; point < end_point; ++point) {
      const int begin = elimination_->PointBegin(point);
      const int end = elimination_->PointEnd(point);
      changes.resize(size_t(end - begin));
      Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
      for (int k = begin; k < end; ++k) {
        const float* by_camera = rows_[k].by_camera.data();
        const float* by_point = rows_[k].by_point.data();
        const double* camera_x = x[observations_.cameras[k]].data();
        for (int r = 0; r < kResidual; ++r) {
          double change = 0;
          for (int i = 0; i < kCamera; ++i) {
            change += double(by_camera[r * kCamera + i]) * camera_x[i];
          }
          changes[k - begin][r] = change;
          for (int i = 0; i < 3; ++i) {
            gradient(i) += double(by_point[r * 3 + i]) * change;
          }
        }
      }
      const Eigen::Vector3d step =
          elimination_->Point(point).inverse.lazyProduct(gradient);
      for (int k = begin; k < end; ++k) {
        const float* by_camera = rows_[k].by_camera.data();
        const float* by_point = rows_[k].by_point.data();
        double* camera_product = (*product)[observations_.cameras[k]].data();
        for (int r = 0; r < kResidual; ++r) {
          double change = changes[k - begin][r];
          for (int i = 0; i < 3; ++i) {
            change -= double(by_point[r * 3 + i]) * step(i);
          }
          for (int i = 0; i < kCamera; ++i) {
            camera_product[i] += double(by_camera[r * kCamera + i]) * change;
          }
        }
      }
    }
  }

  const ColumnGroups& groups_;
  Elimination* elimination_;
  const ObservationIndex& observations_;
  const std::vector<CameraColumns>& columns_;
  const int num_columns_;
  std::vector<FloatRow> rows_;
  // Diagonal blocks of the reduced matrix.
  std::vector<CameraMatrix> blocks_;
  // Index of each column in its group.
  std::vector<int> place_in_group_;
  std::vector<Eigen::LLT<GroupMatrix>> group_factors_;
  Eigen::VectorXd inverse_diagonal_;
  std::vector<int> part_begin_;
  std::vector<std::vector<CameraVector>> products_;
};

}  // namespace dgsfm
