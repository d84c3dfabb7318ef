// HDF5 files that hold arrays in groups: depth maps (a group per image) and
// correspondences (a group per pair). Built without libhdf5, every call throws
// an error that names the missing library.

#pragma once

#include "colmap_ext/formats/depth_file_formats.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm::internal {

// Whether the path ends in .h5 or .hdf5.
bool IsHdf5Path(const std::string& path);

// An open file. Methods throw std::runtime_error with the reason.
//
// libhdf5 reads and writes out of bounds, or goes in circles, where a file is
// damaged on purpose. So a child process reads, which gets 4 GB of memory
// beyond what this one has, and `max_seconds` of processor time for each
// answer; the largest map takes some 10. A crash there is an error here.
// Objects are independent of each other, also in threads; one serves one thread
// at a time.
class Hdf5File {
 public:
  explicit Hdf5File(const std::string& path, int max_seconds = 60);
  ~Hdf5File();

  // Paths, without a leading slash, of all groups that hold the data set `name`
  // or, without a name, any data set; sorted.
  std::vector<std::string> FindGroups(const std::string& name) const;

  // A data set of numbers as floats; nothing if there is none of that name in
  // the group. Refuses more than a file of this size can hold.
  std::optional<NumberArray> Read(const std::string& group,
                                  const std::string& name) const;

 private:
  class Reader;
  std::unique_ptr<Reader> reader_;
};

}  // namespace dgsfm::internal
