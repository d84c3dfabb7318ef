#include "controllers/output_folder.h"

#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace dgsfm {

namespace fs = std::filesystem;

void CreateOutputFolder(const std::string& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (!fs::is_directory(path)) {
    throw std::runtime_error("cannot create the output folder " + path +
                             (error ? ": " + error.message() : ""));
  }
}

void WriteTextFile(const std::string& path, const std::string& text) {
  std::ofstream file(path);
  file << text;
  file.close();
  if (!file) throw std::runtime_error("cannot write " + path);
}

}  // namespace dgsfm
