#include "colmap_ext/formats/dense_match_file.h"

#include "colmap_ext/formats/hdf5_format.h"
#include "colmap_ext/formats/npz_format.h"

#include <algorithm>
#include <filesystem>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;
using internal::NumberArray;

constexpr char kExtension[] = ".npz";

// N x num_cols numbers.
std::vector<float> CheckedValues(NumberArray array,
                                 const std::string& name,
                                 size_t num_cols) {
  const bool is_vector = num_cols == 1 && array.shape.size() == 1;
  if (!is_vector && (array.shape.size() != 2 || array.shape[1] != num_cols)) {
    throw std::runtime_error("the array " + name + " is not N x " +
                             std::to_string(num_cols));
  }
  return std::move(array.values);
}

// Takes two columns of a matrix of `stride` columns.
std::vector<Eigen::Vector2f> Points(const std::vector<float>& values,
                                    size_t first,
                                    size_t stride) {
  std::vector<Eigen::Vector2f> points;
  points.reserve(values.size() / stride);
  for (size_t i = first; i + 1 < values.size(); i += stride) {
    points.emplace_back(values[i], values[i + 1]);
  }
  return points;
}

// `read` gives the array of a name, if there is one.
template <typename Read>
DenseMatches ReadArrays(const Read& read) {
  DenseMatches matches;
  bool is_found = false;
  for (const std::string name : {"keypoints", "mkpts"}) {
    auto points1 = read(name + "0");
    auto points2 = read(name + "1");
    is_found = points1 && points2;
    if (!is_found) continue;
    matches.points1 =
        Points(CheckedValues(std::move(*points1), name + "0", 2), 0, 2);
    matches.points2 =
        Points(CheckedValues(std::move(*points2), name + "1", 2), 0, 2);
    break;
  }
  if (!is_found) {
    auto array = read("matches");
    if (!array) {
      throw std::runtime_error(
          "no arrays keypoints0 and keypoints1, mkpts0 and mkpts1, or matches");
    }
    const auto values = CheckedValues(std::move(*array), "matches", 4);
    matches.points1 = Points(values, 0, 4);
    matches.points2 = Points(values, 2, 4);
  }
  for (const char* name : {"confidence", "certainty", "mconf", "scores"}) {
    if (auto array = read(name)) {
      matches.confidences = CheckedValues(std::move(*array), name, 1);
      break;
    }
  }
  // Matchers write one row per match; anything else cannot be paired.
  if (matches.points1.size() != matches.points2.size() ||
      (!matches.confidences.empty() &&
       matches.confidences.size() != matches.points1.size())) {
    throw std::runtime_error("arrays of different lengths");
  }
  return matches;
}

// The groups of arrays "GROUP/ARRAY".
std::vector<std::string> GroupsOfArrays(const std::vector<std::string>& names) {
  std::set<std::string> groups;
  for (const std::string& name : names) {
    const size_t slash = name.rfind('/');
    if (slash != std::string::npos) groups.insert(name.substr(0, slash));
  }
  return {groups.begin(), groups.end()};
}

// Sorted, because folders list their files in no particular order.
std::vector<std::string> ListArchives(const std::string& folder) {
  std::vector<std::string> groups;
  for (const fs::directory_entry& entry :
       fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file() || entry.path().extension() != kExtension) {
      continue;
    }
    groups.push_back(entry.path()
                         .lexically_relative(folder)
                         .replace_extension()
                         .generic_string());
  }
  std::sort(groups.begin(), groups.end());
  return groups;
}

}  // namespace

struct DenseMatchFile::Impl {
  explicit Impl(const std::string& path) {
    if (fs::is_directory(path)) {
      folder = path;
      groups = ListArchives(path);
    } else if (internal::IsHdf5Path(path)) {
      hdf5.emplace(path);
      groups = hdf5->FindGroups("");
    } else if (fs::path(path).extension() == kExtension) {
      npz.emplace(path);
      groups = GroupsOfArrays(npz->Names());
    } else {
      throw std::runtime_error(
          "neither a folder nor a file .npz, .h5 or .hdf5");
    }
  }

  explicit Impl(std::map<std::string, ArrayReader> given)
      : arrays(std::move(given)) {
    for (const auto& [group, reader] : arrays) groups.push_back(group);
  }

  DenseMatches Read(const std::string& group) const {
    if (const auto reader = arrays.find(group); reader != arrays.end()) {
      return ReadArrays(reader->second);
    }
    if (hdf5) {
      return ReadArrays(
          [&](const std::string& name) { return hdf5->Read(group, name); });
    }
    if (npz) {
      return ReadArrays([&](const std::string& name) {
        return npz->Read(group + "/" + name);
      });
    }
    const internal::NpzFile file(
        (fs::path(folder) / (group + kExtension)).string());
    return ReadArrays([&](const std::string& name) { return file.Read(name); });
  }

  std::map<std::string, ArrayReader> arrays;
  std::string folder;
  std::optional<internal::Hdf5File> hdf5;
  std::optional<internal::NpzFile> npz;
  std::vector<std::string> groups;
};

DenseMatchFile::DenseMatchFile(const std::string& path) : path_(path) {
  try {
    impl_ = std::make_unique<Impl>(path);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(path + ": " + error.what());
  }
}

DenseMatchFile::DenseMatchFile(const std::string& path,
                               std::map<std::string, ArrayReader> arrays)
    : path_(path), impl_(std::make_unique<Impl>(std::move(arrays))) {}

DenseMatchFile::~DenseMatchFile() = default;

const std::vector<std::string>& DenseMatchFile::Groups() const {
  return impl_->groups;
}

DenseMatches DenseMatchFile::Read(const std::string& group) const {
  try {
    return impl_->Read(group);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(path_ + ", pair " + group + ": " + error.what());
  }
}

}  // namespace dgsfm
