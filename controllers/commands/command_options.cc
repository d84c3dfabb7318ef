#include "controllers/commands/command_options.h"

#include "colmap_ext/check.h"
#include "colmap_ext/output_file.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <functional>
#include <iostream>
#include <map>
#include <sstream>
#include <stdexcept>
#include <type_traits>
#include <vector>

#include <boost/program_options.hpp>
#include <boost/property_tree/ini_parser.hpp>
#include <boost/property_tree/ptree.hpp>
#include <glog/logging.h>

namespace dgsfm {
namespace {

namespace po = boost::program_options;

// The shortest text that reads back as the same value.
template <typename T>
std::string ToText(const T& value) {
  if constexpr (std::is_same_v<T, std::string>) {
    return value;
  } else if constexpr (std::is_same_v<T, bool>) {
    return value ? "1" : "0";
  } else {
    char buffer[32];
    const auto [end, error] = std::to_chars(buffer, std::end(buffer), value);
    DGSFM_CHECK(error == std::errc());
    return std::string(buffer, end);
  }
}

std::string ToText(const CommandOptions::Value& value) {
  return std::visit([](const auto& typed) { return ToText(typed); }, value);
}

template <typename T>
std::string TypeName() {
  if constexpr (std::is_same_v<T, bool>) return "a truth value";
  if constexpr (std::is_same_v<T, int>) return "a whole number";
  if constexpr (std::is_same_v<T, double>) return "a number";
  return "a text";
}

bool IsQuoted(const std::string& text) {
  return text.size() >= 2 && text.front() == '"' && text.back() == '"';
}

// Readers of project files trim values: quotes keep spaces at the ends.
std::string Quote(const std::string& text) {
  const char* kSpaces = " \t\r\v\f";
  const bool is_trimmed = text.find_first_of(kSpaces) != 0 &&
                          text.find_last_of(kSpaces) + 1 != text.size();
  return text.empty() || (is_trimmed && !IsQuoted(text)) ? text
                                                         : '"' + text + '"';
}

std::string Unquote(const std::string& text) {
  return IsQuoted(text) ? text.substr(1, text.size() - 2) : text;
}

// Reads "name=value" lines, after a line [Group] as "Group.name".
po::parsed_options ParseProject(const boost::property_tree::ptree& tree,
                                const std::string& path,
                                const po::options_description& description) {
  po::parsed_options parsed(&description);
  const auto add = [&](const std::string& name, const std::string& value) {
    if (description.find_nothrow(name, /*approx=*/false) == nullptr) {
      throw po::error("unrecognised option '" + name + "' in " + path);
    }
    parsed.options.emplace_back(name, std::vector<std::string>{Unquote(value)});
  };
  for (const auto& [name, node] : tree) {
    if (node.empty()) add(name, node.data());
    for (const auto& [field, leaf] : node) {
      add(name + "." + field, leaf.data());
    }
  }
  return parsed;
}

po::parsed_options ReadProject(const std::string& path,
                               const po::options_description& description) {
  if (!std::filesystem::is_regular_file(path)) {
    throw std::runtime_error("project file " + path + " does not exist");
  }
  boost::property_tree::ptree tree;
  try {
    boost::property_tree::read_ini(path, tree);
  } catch (const boost::property_tree::ini_parser_error& error) {
    throw std::runtime_error(std::string("cannot read project file ") +
                             error.what());
  }
  return ParseProject(tree, path, description);
}

// Where Parse() describes the options instead.
thread_local CommandDescription* requested_description = nullptr;

std::string DescriptionType(const CommandOptions::Option& option) {
  if (!option.choices.empty()) return "choice";
  const CommandOptions::Value value = option.get();
  if (std::holds_alternative<bool>(value)) return "flag";
  if (std::holds_alternative<int>(value)) return "integer";
  return std::holds_alternative<double>(value) ? "number" : "text";
}

}  // namespace

struct CommandOptions::Impl {
  std::string command;
  std::string summary;
  std::string project_path;
  // What a project file may hold, and what only the command line may.
  po::options_description description{"Options", 80, 44};
  po::options_description general{"General options", 80, 44};
  std::vector<Option> options;

  template <typename T>
  void Add(const std::string& name,
           T* value,
           const std::string& help,
           bool is_required) {
    auto* semantic = po::value<T>(value);
    if (is_required) {
      semantic->required();
    } else {
      semantic->default_value(*value, ToText(*value));
    }
    if constexpr (std::is_same_v<T, double>) {
      semantic->notifier([name](double number) {
        if (std::isnan(number)) {
          throw po::validation_error(
              po::validation_error::invalid_option_value, name, "nan");
        }
      });
    }
    description.add_options()(
        name.c_str(),
        semantic,
        (help + (is_required ? " (required)" : "")).c_str());
    const auto set = [name, value](const Value& given) {
      const T* of_type = std::get_if<T>(&given);
      if (of_type == nullptr) {
        throw std::runtime_error("option " + name + " must be " +
                                 TypeName<T>() + ", but is " + ToText(given));
      }
      if constexpr (std::is_same_v<T, double>) {
        if (std::isnan(*of_type)) {
          throw std::runtime_error("option " + name + " must not be nan");
        }
      }
      *value = *of_type;
    };
    options.push_back(
        {name, help, is_required, {}, [value] { return Value(*value); }, set});
  }

  // The command line goes first because the first value of an option wins.
  // Throws po::error; returns false after --help.
  bool ParseOrThrow(int argc, char** argv) {
    po::options_description all;
    all.add(description).add(general);
    const po::parsed_options parsed =
        po::command_line_parser(argc, argv)
            .options(all)
            .style(po::command_line_style::unix_style &
                   ~po::command_line_style::allow_guessing)
            .run();
    for (const po::option& option : parsed.options) {
      if (option.string_key.empty()) {
        throw po::error("unexpected argument '" + option.value.front() + "'");
      }
    }
    po::variables_map values;
    po::store(parsed, values);
    if (values.count("help") > 0) return false;
    if (values.count("log_level") > 0) FLAGS_v = values["log_level"].as<int>();
    if (values.count("project_path") > 0) {
      po::store(
          ReadProject(values["project_path"].as<std::string>(), description),
          values);
    }
    po::notify(values);
    return true;
  }
};

CommandOptions::CommandOptions(const std::string& command,
                               const std::string& summary)
    : impl_(std::make_unique<Impl>()) {
  impl_->command = command;
  impl_->summary = summary;
  impl_->general.add_options()("help,h", "Show this text.")(
      "project_path",
      po::value<std::string>(),
      "File with options; those of the command line win.")(
      "log_level,v",
      po::value<int>(),
      "Log of the run: 0 is its story, 1 adds the figures of each stage");
}

CommandOptions::~CommandOptions() = default;

template <typename T>
void CommandOptions::Add(const std::string& name,
                         T* value,
                         const std::string& help) {
  impl_->Add(name, value, help, /*is_required=*/false);
}

template <typename T>
void CommandOptions::AddRequired(const std::string& name,
                                 T* value,
                                 const std::string& help) {
  impl_->Add(name, value, help, /*is_required=*/true);
}

void CommandOptions::AddText(const std::string& name,
                             const std::vector<std::string>& choices,
                             const std::function<std::string()>& get,
                             const std::function<void(const std::string&)>& set,
                             const std::string& help) {
  const auto checked_set = [name, choices, set](const std::string& text) {
    if (std::find(choices.begin(), choices.end(), text) == choices.end()) {
      std::string expected;
      for (const std::string& choice : choices) {
        expected += (expected.empty() ? "" : ", ") + choice;
      }
      throw std::runtime_error(name + " is '" + text + "' but must be one of " +
                               expected);
    }
    set(text);
  };
  impl_->description.add_options()(
      name.c_str(),
      po::value<std::string>()->default_value(get())->notifier(
          [checked_set](const std::string& text) {
            try {
              checked_set(text);
            } catch (const std::runtime_error& error) {
              throw po::error(error.what());
            }
          }),
      help.c_str());
  const auto set_value = [name, checked_set](const Value& given) {
    const std::string* text = std::get_if<std::string>(&given);
    if (text == nullptr) {
      throw std::runtime_error("option " + name + " must be a text, but is " +
                               ToText(given));
    }
    checked_set(*text);
  };
  impl_->options.push_back({name,
                            help,
                            /*is_required=*/false,
                            choices,
                            [get] { return Value(get()); },
                            set_value});
}

const std::vector<CommandOptions::Option>& CommandOptions::Options() const {
  return impl_->options;
}

#define DGSFM_INSTANTIATE(T)                       \
  template void CommandOptions::Add<T>(            \
      const std::string&, T*, const std::string&); \
  template void CommandOptions::AddRequired<T>(    \
      const std::string&, T*, const std::string&);
DGSFM_INSTANTIATE(bool)
DGSFM_INSTANTIATE(int)
DGSFM_INSTANTIATE(double)
DGSFM_INSTANTIATE(std::string)
#undef DGSFM_INSTANTIATE

CommandDescription DescribeOptions(const std::function<int()>& run) {
  CommandDescription description;
  requested_description = &description;
  run();
  requested_description = nullptr;
  return description;
}

std::optional<int> CommandOptions::Parse(int argc, char** argv) {
  if (requested_description != nullptr) {
    requested_description->command = impl_->command;
    requested_description->summary = impl_->summary;
    for (const Option& option : impl_->options) {
      requested_description->options.push_back(
          {option.name,
           DescriptionType(option),
           option.is_required ? "" : ToText(option.get()),
           option.help,
           option.is_required,
           option.choices});
    }
    return 0;
  }
  try {
    if (impl_->ParseOrThrow(argc, argv)) return std::nullopt;
  } catch (const po::error& error) {
    std::cerr << "ERROR: " << error.what() << "\nSee: colmap " << impl_->command
              << " --help" << std::endl;
    return 2;
  }
  std::cout << "colmap " << impl_->command << ": " << impl_->summary << "\n\n"
            << impl_->description << "\n"
            << impl_->general << std::flush;
  return 0;
}

std::string CommandOptions::ProjectText() const {
  std::string text;
  std::map<std::string, std::string> groups;
  for (const Option& option : impl_->options) {
    const std::string value = ToText(option.get());
    if (value.find('\n') != std::string::npos) {
      throw std::runtime_error("option " + option.name +
                               " contains a line break");
    }
    const size_t dot = option.name.find('.');
    std::string& lines =
        dot == std::string::npos ? text : groups[option.name.substr(0, dot)];
    lines += option.name.substr(dot + 1) + "=" + Quote(value) + "\n";
  }
  for (const auto& [group, lines] : groups) {
    text += "[" + group + "]\n" + lines;
  }
  return text;
}

void CommandOptions::SetFromProjectText(const std::string& text) {
  try {
    boost::property_tree::ptree tree;
    std::istringstream stream(text);
    boost::property_tree::read_ini(stream, tree);
    po::variables_map values;
    po::store(ParseProject(tree, "the options", impl_->description), values);
    po::notify(values);
  } catch (const boost::property_tree::ini_parser_error& error) {
    throw std::runtime_error(std::string("damaged options: ") + error.what());
  } catch (const po::error& error) {
    throw std::runtime_error(error.what());
  }
}

void CommandOptions::WriteProject(const std::string& path) const {
  WriteFile(path, ProjectText());
}

}  // namespace dgsfm
