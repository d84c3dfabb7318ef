// Options of a command: bound in one place, shown by --help with default and
// unit, read from a project file and written back to one.

#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace dgsfm {

class CommandOptions {
 public:
  using Value = std::variant<bool, int, double, std::string>;

  // An option as it was bound.
  struct Option {
    std::string name;
    std::string help;
    bool is_required = false;
    // The texts that the value may have; empty for any.
    std::vector<std::string> choices;
    std::function<Value()> get;
    // Throws std::runtime_error, naming the option, for a value of another type
    // than that of get(), for NaN, and for texts beside the choices.
    std::function<void(const Value&)> set;
  };

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

  // Binds an option whose text names one of the choices.
  template <typename T>
  void AddChoice(const std::string& name,
                 T* value,
                 const std::vector<std::pair<std::string, T>>& choices,
                 const std::string& help);

  // In the order in which they were bound.
  const std::vector<Option>& Options() const;

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
  // Sets options as ProjectText() gave them. Throws std::runtime_error if a
  // line is damaged or has an option that is not bound here.
  void SetFromProjectText(const std::string& text);

 private:
  struct Impl;

  void AddText(const std::string& name,
               const std::vector<std::string>& choices,
               const std::function<std::string()>& get,
               const std::function<void(const std::string&)>& set,
               const std::string& help);

  std::unique_ptr<Impl> impl_;
};

template <typename T>
void CommandOptions::AddChoice(
    const std::string& name,
    T* value,
    const std::vector<std::pair<std::string, T>>& choices,
    const std::string& help) {
  std::vector<std::string> texts;
  for (const auto& [text, choice] : choices) texts.push_back(text);
  AddText(
      name,
      texts,
      [value, choices] {
        for (const auto& [text, choice] : choices) {
          if (choice == *value) return text;
        }
        return std::string();
      },
      [value, choices](const std::string& chosen) {
        for (const auto& [text, choice] : choices) {
          if (text == chosen) *value = choice;
        }
      },
      help);
}

// What --help shows of a command, for documents that are made of it.
struct CommandDescription {
  struct Option {
    std::string name;
    // "flag" (0 or 1), "integer", "number", "text" or "choice".
    std::string type;
    // As on the command line; empty for a required option.
    std::string default_text;
    std::string help;
    bool is_required = false;
    std::vector<std::string> choices;
  };

  std::string command;
  // A sentence, and the line of `colmap help`.
  std::string summary;
  std::string headline;
  // In the order of --help, without what all commands have.
  std::vector<Option> options;
};

// What the first options that `run` parses in this thread are; Parse() then
// ends the command with exit code 0 and prints nothing.
CommandDescription DescribeOptions(const std::function<int()>& run);

// Options that a command cannot run with.
struct UsageError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Throws a UsageError with the reason unless the options are valid.
template <typename Options>
void CheckOptions(const Options& options) {
  std::string error;
  if (!options.IsValid(&error)) throw UsageError(error);
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
