#pragma once

#include <optional>
#include <string>

namespace dgsfm {

// An empty folder for the running test, named after it and emptied first.
std::string CreateTestDir();

// All bytes of a file; empty if it cannot be read.
std::string FileContent(const std::string& path);

// A data set of ../shared/data beside the project, e.g. "fountain-P11", or
// nothing where it is absent: the test then skips and says so.
std::optional<std::string> SharedDataSet(const std::string& name);

}  // namespace dgsfm
