// Folders that commands write, and text for files in them.

#pragma once

#include <set>
#include <string>
#include <utility>
#include <vector>

namespace dgsfm {

// Creates the folder with those above it where they are missing. Throws
// std::runtime_error naming it if that fails or it is a file.
void CreateOutputFolder(const std::string& path);

// Name of a folder without those above it, as a title.
std::string FolderName(const std::string& path);

// A nlohmann::json or ordered_json as text. Names of files need not be UTF-8,
// as JSON has to be: other bytes become U+FFFD. An indent of -1 gives one line.
template <typename Json>
std::string JsonText(const Json& json, int indent) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace);
}

// The output of a run that replaces the output of an earlier run: models in
// folders "0", "1" and so on, and some files. A manifest in the folder lists
// the files that a run of this program wrote. All else is somebody's own: where
// it has the place of an output, the run is refused.
//
// The output is staged in a folder below and gets its names together at the
// end, each in one step. Functions throw std::runtime_error naming the file.
class RunFolder {
 public:
  // Creates the folder; files are names of what the run will stage beside
  // models.
  RunFolder(const std::string& path, const std::vector<std::string>& files);
  ~RunFolder();
  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;

  // Where to write a file or the files of a model until Publish().
  std::string StagedFile(const std::string& name) const;
  std::string StagedModel(size_t index) const;

  // Puts what was staged into its place, and removes what earlier runs wrote
  // beyond that. Where this fails the staged output stays.
  void Publish();

 private:
  bool IsOutput(const std::string& name) const;
  void CheckOthersFiles() const;

  const std::string path_;
  const std::set<std::string> files_;
  const std::string staging_path_;
  std::set<std::string> manifest_;
  bool is_publishing_ = false;
};

// A folder, and names of files below it.
using FilesOfFolder = std::pair<std::string, std::set<std::string>>;

// Makes files the output of this run and of later ones with the same folders,
// for commands whose output lies among others' files, and creates the folders,
// in each of which a list has what was claimed. Throws std::runtime_error
// naming the file, and writes nothing, if one exists that the list lacks, or is
// wanted twice.
void ClaimFiles(const std::vector<FilesOfFolder>& files);

// Makes a file part of the run's output, which the next run replaces, if it is
// in the folder of a run.
void AddToRun(const std::string& file_path);

}  // namespace dgsfm
