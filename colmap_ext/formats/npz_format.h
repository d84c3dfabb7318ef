// NumPy archives: arrays by name, stored or deflated.

#pragma once

#include "colmap_ext/formats/depth_file_formats.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm::internal {

// An open archive. Methods throw std::runtime_error with the reason if it or
// the array is damaged. Not thread-safe.
class NpzFile {
 public:
  explicit NpzFile(const std::string& path);
  ~NpzFile();

  // Names of the arrays, without ".npy", in the order of the archive.
  std::vector<std::string> Names() const;

  // Nothing if there is none of that name.
  std::optional<NumberArray> Read(const std::string& name) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dgsfm::internal
