#include "colmap_ext/formats/npz_format.h"

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <utility>

#include <zip.h>

namespace dgsfm::internal {
namespace {

const std::string kExtension = ".npy";

struct ZipCloser {
  void operator()(zip_t* archive) const { zip_discard(archive); }
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};

std::unique_ptr<zip_t, ZipCloser> OpenArchive(const std::string& path) {
  int code = 0;
  std::unique_ptr<zip_t, ZipCloser> archive(
      zip_open(path.c_str(), ZIP_RDONLY, &code));
  if (archive == nullptr) {
    zip_error_t error;
    zip_error_init_with_code(&error, code);
    const std::string reason = zip_error_strerror(&error);
    zip_error_fini(&error);
    throw std::runtime_error("no NumPy archive: " + reason);
  }
  return archive;
}

// Before allocating what a damaged size asks for; that of the compressed data
// is not to be believed either.
void CheckSize(const zip_stat_t& stat,
               uint64_t file_size,
               const std::string& array) {
  constexpr zip_uint64_t kNeeded =
      ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
  if ((stat.valid & kNeeded) != kNeeded ||
      (stat.comp_method != ZIP_CM_STORE &&
       stat.comp_method != ZIP_CM_DEFLATE)) {
    throw std::runtime_error(array + " is neither stored nor deflated");
  }
  if (stat.size > kMaxFileBytes ||
      stat.size / kMaxDeflateRatio > std::min(stat.comp_size, file_size)) {
    throw std::runtime_error(array + " has an impossible size of " +
                             std::to_string(stat.size) + " bytes");
  }
}

}  // namespace

struct NpzFile::Impl {
  std::unique_ptr<zip_t, ZipCloser> archive;
  uint64_t file_size = 0;
};

NpzFile::NpzFile(const std::string& path)
    : impl_(std::make_unique<Impl>(
          Impl{OpenArchive(path), std::filesystem::file_size(path)})) {}

NpzFile::~NpzFile() = default;

std::vector<std::string> NpzFile::Names() const {
  std::vector<std::string> names;
  const zip_int64_t num_entries = zip_get_num_entries(impl_->archive.get(), 0);
  for (zip_int64_t i = 0; i < num_entries; ++i) {
    const char* name = zip_get_name(impl_->archive.get(), i, 0);
    // A damaged entry; the others may be whole.
    if (name == nullptr) continue;
    const std::string text = name;
    if (text.size() <= kExtension.size() ||
        text.substr(text.size() - kExtension.size()) != kExtension) {
      continue;
    }
    names.push_back(text.substr(0, text.size() - kExtension.size()));
  }
  return names;
}

std::optional<NumberArray> NpzFile::Read(const std::string& name) const {
  zip_t* archive = impl_->archive.get();
  const std::string array = "the array " + name;
  zip_stat_t stat;
  zip_stat_init(&stat);
  // Callers ask for optional arrays by name, so a missing one is not an error.
  if (zip_stat(archive, (name + kExtension).c_str(), 0, &stat) != 0) {
    return std::nullopt;
  }
  CheckSize(stat, impl_->file_size, array);
  const std::unique_ptr<zip_file_t, ZipCloser> file(
      zip_fopen_index(archive, stat.index, 0));
  if (file == nullptr) {
    throw std::runtime_error(array + ": " + zip_strerror(archive));
  }
  std::string bytes(stat.size, '\0');
  const zip_int64_t num_read =
      zip_fread(file.get(), bytes.data(), bytes.size());
  // Reading on past the end makes libzip compare the checksum.
  uint8_t extra = 0;
  if (num_read < 0 || zip_fread(file.get(), &extra, 1) != 0 ||
      static_cast<uint64_t>(num_read) != stat.size) {
    throw std::runtime_error(array +
                             " is damaged: " + zip_file_strerror(file.get()));
  }
  try {
    return ParseNpy(std::move(bytes));
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(array + ": " + error.what());
  }
}

}  // namespace dgsfm::internal
