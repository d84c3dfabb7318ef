// Options of a command: bound in one place, shown by --help with default and
// unit, read from a project file and written back to one.

#pragma once

#include <iostream>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace dgsfm {

class CommandOptions {
 public:
  // `command` as typed by the user, `summary` one sentence for --help.
  CommandOptions(const std::string& command, const std::string& summary);
  ~CommandOptions();

  // Binds an option of type bool, int, double or std::string; the value it
  // has now is the default. Names are as in COLMAP: "database_path", or
  // "Group.field". `help` states meaning and unit. Booleans are 0 or 1.
  template <typename T>
  void Add(const std::string& name, T* value, const std::string& help);
  template <typename T>
  void AddRequired(const std::string& name, T* value, const std::string& help);

  // Reads the command line (argv[0] is the program, the command's own name
  // already removed) and, if --project_path is given, that file first: the
  // command line wins. Returns the exit code if the command is over: 0 after
  // --help, 2 after an unknown option, a missing required one or a value that
  // does not parse, each with a message on stderr that names it.
  std::optional<int> Parse(int argc, char** argv);

  // All options with their values, as a project file has them. Throws
  // std::runtime_error if a value cannot be written there.
  std::string ProjectText() const;
  // Writes all options with their values as a project file that
  // --project_path reads. Throws std::runtime_error if it cannot be written.
  void WriteProject(const std::string& path) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Throws std::runtime_error with the reason unless the options are valid.
template <typename Options>
void CheckOptions(const Options& options) {
  std::string error;
  if (!options.IsValid(&error)) throw std::runtime_error(error);
}

// Finds the value of the choice that the text of an option names; otherwise
// false and a message on stderr.
template <typename T>
bool ParseChoice(const std::string& name,
                 const std::string& text,
                 const std::vector<std::pair<std::string, T>>& choices,
                 T* value) {
  std::string expected;
  for (const auto& [choice, choice_value] : choices) {
    if (text == choice) {
      *value = choice_value;
      return true;
    }
    expected += (expected.empty() ? "" : ", ") + choice;
  }
  std::cerr << "ERROR: " << name << " is '" << text << "' but must be one of "
            << expected << std::endl;
  return false;
}

// Adds options whose names begin with that of their group: "Group.field".
class OptionGroup {
 public:
  OptionGroup(const std::string& group, CommandOptions* options)
      : prefix_(group + "."), options_(options) {}
  template <typename T>
  OptionGroup& Add(const std::string& field,
                   T* value,
                   const std::string& help) {
    options_->Add(prefix_ + field, value, help);
    return *this;
  }

 private:
  std::string prefix_;
  CommandOptions* options_;
};

}  // namespace dgsfm
