// What we need of libhdf5, called directly. Nothing but hdf5_format.h, which
// does so in a process of its own, is to use it.

#pragma once

#include "colmap_ext/formats/depth_file_formats.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace dgsfm::internal {

// An open file. Methods throw std::runtime_error with the reason, without
// libhdf5 at build time always. Not thread-safe, not even with one object per
// thread: so it is with libhdf5. On files damaged on purpose libhdf5 may crash.
class Hdf5Library {
 public:
  explicit Hdf5Library(const std::string& path);
  ~Hdf5Library();

  // See Hdf5File.
  std::vector<std::string> FindGroups(const std::string& name) const;
  std::optional<NumberArray> Read(const std::string& group,
                                  const std::string& name) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dgsfm::internal
