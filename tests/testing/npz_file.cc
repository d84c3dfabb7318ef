#include "tests/testing/npz_file.h"

#include <stdexcept>

namespace dgsfm {

void AddToNpz(const std::string& path,
              const std::string& name,
              const std::string& bytes,
              int method) {
  zip_t* archive = zip_open(path.c_str(), ZIP_CREATE, nullptr);
  zip_source_t* source =
      zip_source_buffer(archive, bytes.data(), bytes.size(), 0);
  const zip_int64_t index = zip_file_add(archive, name.c_str(), source, 0);
  zip_set_file_compression(archive, index, method, 0);
  if (zip_close(archive) != 0) throw std::runtime_error("cannot write " + path);
}

}  // namespace dgsfm
