#include "controllers/output_folder.h"

#include "colmap_ext/output_file.h"

#include <filesystem>
#include <fstream>
#include <map>
#include <stdexcept>

namespace dgsfm {
namespace {

namespace fs = std::filesystem;

// Readers of models take no folder for one whose name begins with a dot.
constexpr char kStaging[] = ".dgsfm_partial";
constexpr char kManifest[] = ".dgsfm_manifest";
constexpr char kClaimed[] = ".dgsfm_claimed";

bool IsModelName(const std::string& name) {
  return !name.empty() &&
         name.find_first_not_of("0123456789") == std::string::npos;
}

// Files at a path, itself or in the folder that it is, relative to the root.
std::set<std::string> ListFiles(const fs::path& path, const fs::path& root) {
  if (!fs::is_directory(fs::symlink_status(path))) {
    return {path.lexically_relative(root).generic_string()};
  }
  std::set<std::string> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(path)) {
    files.merge(ListFiles(entry.path(), root));
  }
  return files;
}

std::vector<fs::path> ListEntries(const fs::path& folder) {
  return {fs::directory_iterator(folder), fs::directory_iterator()};
}

std::set<std::string> ReadManifest(const fs::path& folder,
                                   const char* name = kManifest) {
  std::set<std::string> files;
  std::ifstream manifest(folder / name);
  for (std::string file; std::getline(manifest, file);) files.insert(file);
  return files;
}

void WriteManifest(const fs::path& folder,
                   const std::set<std::string>& files,
                   const char* name = kManifest) {
  std::string text;
  for (const std::string& file : files) text += file + "\n";
  WriteFile((folder / name).string(), text);
}

[[noreturn]] void RefuseToReplace(const fs::path& file) {
  throw std::runtime_error(
      file.string() +
      " is in the way and was not written by an earlier run: move it away, "
      "or choose another output folder");
}

}  // namespace

void CreateOutputFolder(const std::string& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (!fs::is_directory(path)) {
    throw std::runtime_error("cannot create the output folder " + path +
                             (error ? ": " + error.message() : ""));
  }
}

std::string FolderName(const std::string& path) {
  const fs::path folder = fs::absolute(path).lexically_normal();
  return (folder.has_filename() ? folder : folder.parent_path())
      .filename()
      .string();
}

RunFolder::RunFolder(const std::string& path,
                     const std::vector<std::string>& files)
    : path_(path),
      files_(files.begin(), files.end()),
      staging_path_((fs::path(path) / kStaging).string()) {
  CreateOutputFolder(path_);
  for (const std::string& file : ReadManifest(path_)) {
    if (IsOutput(file.substr(0, file.find('/')))) manifest_.insert(file);
  }
  CheckOthersFiles();
  // A killed run may have left its half-written models.
  fs::remove_all(staging_path_);
  CreateOutputFolder(staging_path_);
}

RunFolder::~RunFolder() {
  std::error_code ignored;
  if (!is_publishing_) fs::remove_all(staging_path_, ignored);
}

std::string RunFolder::StagedFile(const std::string& name) const {
  return (fs::path(staging_path_) / name).string();
}

std::string RunFolder::StagedModel(size_t index) const {
  const std::string path = StagedFile(std::to_string(index));
  CreateOutputFolder(path);
  return path;
}

void RunFolder::Publish() {
  // From here on the staging folder may hold models of an earlier run.
  is_publishing_ = true;
  CheckOthersFiles();
  const std::set<std::string> files = ListFiles(staging_path_, staging_path_);
  std::set<std::string> files_of_both = manifest_;
  files_of_both.insert(files.begin(), files.end());
  // Written first: a run killed in between still owns both sets of files.
  WriteManifest(path_, files_of_both);
  std::set<std::string> names;
  for (const fs::path& staged : ListEntries(staging_path_)) {
    const std::string name = staged.filename().string();
    names.insert(name);
    const std::string target = (fs::path(path_) / name).string();
    if (fs::is_directory(staged)) {
      ReplaceFolder(staged.string(), target);
    } else {
      fs::rename(staged, target);
    }
  }
  // A model that is left from an earlier run goes whole as well.
  for (const std::string& file : manifest_) {
    const std::string name = file.substr(0, file.find('/'));
    const fs::path path = fs::path(path_) / name;
    if (names.count(name) == 0 && fs::exists(fs::symlink_status(path))) {
      fs::rename(path, StagedFile(name + ".stale"));
    }
  }
  WriteManifest(path_, files);
  fs::remove_all(staging_path_);
}

// Whether a run has its output at a name in the folder.
bool RunFolder::IsOutput(const std::string& name) const {
  return IsModelName(name) || files_.count(name) > 0;
}

void RunFolder::CheckOthersFiles() const {
  for (const fs::path& entry : ListEntries(path_)) {
    const std::string name = entry.filename().string();
    if (!IsOutput(name)) continue;
    for (const std::string& file : ListFiles(entry, path_)) {
      if (manifest_.count(file) == 0) RefuseToReplace(fs::path(path_) / file);
    }
  }
}

void ClaimFiles(const std::vector<FilesOfFolder>& files) {
  // By folder, which several may share.
  std::map<fs::path, std::set<std::string>> claimed;
  std::set<fs::path> paths;
  for (const auto& [folder, names] : files) {
    std::error_code ignored;
    const fs::path canonical =
        fs::weakly_canonical(fs::absolute(folder) / "", ignored);
    const std::set<std::string> own = ReadManifest(canonical, kClaimed);
    for (const std::string& name : names) {
      const fs::path path = PathInside(folder, name);
      if (fs::exists(fs::symlink_status(path, ignored)) &&
          own.count(name) == 0) {
        RefuseToReplace(path);
      }
      if (!paths.insert((canonical / name).lexically_normal()).second) {
        throw std::runtime_error(path.string() +
                                 " would be written twice: choose different "
                                 "output folders");
      }
    }
    claimed[canonical].insert(own.begin(), own.end());
    claimed[canonical].insert(names.begin(), names.end());
  }
  for (const auto& [folder, names] : files) CreateOutputFolder(folder);
  for (const auto& [folder, names] : claimed) {
    WriteManifest(folder, names, kClaimed);
  }
}

void AddToRun(const std::string& file_path) {
  const fs::path path = fs::absolute(file_path);
  const fs::path folder = path.parent_path();
  if (!fs::exists(folder / kManifest)) return;
  std::set<std::string> files = ReadManifest(folder);
  if (files.insert(path.filename().string()).second) {
    WriteManifest(folder, files);
  }
}

}  // namespace dgsfm
