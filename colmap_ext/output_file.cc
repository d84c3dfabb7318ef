#include "colmap_ext/output_file.h"

#include "colmap_ext/fnv_hash.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include <fcntl.h>
#include <unistd.h>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

constexpr size_t kBufferSize = 1 << 20;

[[noreturn]] void Fail(const std::string& path) {
  const std::string reason = std::strerror(errno);
  throw std::runtime_error("cannot write " + path + ": " + reason);
}

// Devices and pipes, and names of open files such as /dev/stdout, which must
// not be replaced.
bool IsStream(const std::string& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  const fs::path folder = fs::path(path).parent_path();
  return fs::is_character_file(status) || fs::is_fifo(status) ||
         folder == "/dev" || folder == "/dev/fd" || folder == "/proc/self/fd";
}

// Makes the names in a folder last. Not all file systems can.
void SyncFolder(const fs::path& path) {
  const std::string name = path.empty() ? "." : path.string();
  const int descriptor = open(name.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (descriptor < 0) Fail(name);
  const bool is_synced = fsync(descriptor) == 0 || errno == EINVAL;
  const int error = errno;
  close(descriptor);
  errno = error;
  if (!is_synced) Fail(name);
}

void Rename(const std::string& from, const std::string& to) {
  if (rename(from.c_str(), to.c_str()) != 0) Fail(to);
}

}  // namespace

std::string PathInside(const std::string& folder, const std::string& name) {
  const fs::path path(name);
  bool is_inside = !name.empty() && !path.is_absolute();
  for (const fs::path& part : path) is_inside &= part != "..";
  if (!is_inside) {
    throw std::runtime_error("image name '" + name +
                             "' leads out of the folder " + folder);
  }
  return (fs::path(folder) / path).string();
}

// The name depends on the path alone, so that what a killed run left is
// replaced by the next; and is short, as the path's own may be of any length.
OutputFile::OutputFile(const std::string& path) : path_(path) {
  int flags = O_WRONLY | O_CLOEXEC | O_APPEND;
  if (!IsStream(path)) {
    const fs::path target(path);
    FnvHash hash;
    hash.AddAll(target.filename().string());
    char name[32];
    std::snprintf(name,
                  sizeof(name),
                  ".%016llx.partial",
                  static_cast<unsigned long long>(hash.Value()));
    partial_path_ = (target.parent_path() / name).string();
    unlink(partial_path_.c_str());
    flags |= O_CREAT | O_EXCL;
  }
  const std::string& opened = partial_path_.empty() ? path_ : partial_path_;
  descriptor_ = open(opened.c_str(), flags, 0666);
  if (descriptor_ < 0) Fail(path_);
}

OutputFile::~OutputFile() {
  if (descriptor_ >= 0) close(descriptor_);
  if (!partial_path_.empty()) unlink(partial_path_.c_str());
}

void OutputFile::Write(std::string_view bytes) {
  buffer_.append(bytes);
  if (buffer_.size() >= kBufferSize) Flush();
}

void OutputFile::Flush() {
  for (size_t i = 0; i < buffer_.size();) {
    const ssize_t num_written =
        write(descriptor_, buffer_.data() + i, buffer_.size() - i);
    // A signal, such as that of a resized terminal, interrupts the call without
    // making it fail.
    if (num_written < 0 && errno == EINTR) continue;
    if (num_written <= 0) Fail(path_);
    i += static_cast<size_t>(num_written);
  }
  buffer_.clear();
}

void OutputFile::Commit() {
  Flush();
  // Streams have nothing to be synced.
  if (!partial_path_.empty() && fsync(descriptor_) != 0) Fail(path_);
  // Even a close that fails releases the descriptor, so it is never closed
  // twice.
  const int descriptor = descriptor_;
  descriptor_ = -1;
  if (close(descriptor) != 0) Fail(path_);
  if (partial_path_.empty()) return;
  Rename(partial_path_, path_);
  partial_path_.clear();
  SyncFolder(fs::path(path_).parent_path());
}

void WriteFile(const std::string& path, std::string_view bytes) {
  OutputFile file(path);
  file.Write(bytes);
  file.Commit();
}

void ReplaceFile(const std::string& partial_path, const std::string& path) {
  const int descriptor = open(partial_path.c_str(), O_RDWR | O_CLOEXEC);
  if (descriptor < 0) Fail(partial_path);
  const bool is_synced = fsync(descriptor) == 0;
  const int error = errno;
  close(descriptor);
  errno = error;
  if (!is_synced) Fail(partial_path);
  Rename(partial_path, path);
  SyncFolder(fs::path(path).parent_path());
}

void ReplaceFolder(const std::string& folder, const std::string& path) {
  SyncFolder(folder);
  std::error_code error;
  if (!fs::exists(fs::symlink_status(path, error))) {
    Rename(folder, path);
  } else if (renameat2(AT_FDCWD,
                       folder.c_str(),
                       AT_FDCWD,
                       path.c_str(),
                       RENAME_EXCHANGE) != 0) {
    // Some network file systems cannot exchange names in one step.
    if (errno != EINVAL && errno != ENOSYS) Fail(path);
    Rename(path, folder + ".old");
    Rename(folder, path);
  }
  SyncFolder(fs::path(path).parent_path());
}

}  // namespace dgsfm
