// Documents that are generated from the options of the commands: man pages,
// completions of shells, and lists for the documentation and for tests.

#include "colmap_ext/output_file.h"
#include "controllers/commands/command_options.h"
#include "controllers/commands/commands.h"
#include "controllers/output_folder.h"

#include <filesystem>
#include <string>
#include <vector>

#include <boost/algorithm/string.hpp>
#include <nlohmann/json.hpp>

namespace dgsfm {

namespace {

using CommandDescriptions = std::vector<CommandDescription>;
using Option = CommandDescription::Option;
namespace ba = boost::algorithm;
namespace fs = std::filesystem;

// Replaces each of the characters by itself after a backslash.
std::string Escape(const std::string& text, const std::string& characters) {
  std::string escaped;
  for (const char character : text) {
    if (characters.find(character) != std::string::npos) escaped += '\\';
    escaped += character;
  }
  return escaped;
}

bool IsPath(const Option& option) {
  return ba::ends_with(option.name, "_path");
}

// The values that a shell can offer, if they are few.
std::vector<std::string> Values(const Option& option) {
  if (option.type == "flag") return {"0", "1"};
  return option.choices;
}

// Text of a man page: a hyphen is a minus, and no line begins with a request.
std::string Roff(const std::string& text) {
  return "\\&" + Escape(text, "\\-");
}

std::string ManHeading(const std::string& title, const std::string& program) {
  return ".TH \"" + Roff(title) + "\" 1 \"\" \"dgsfm " DGSFM_VERSION "\" \"" +
         Roff(program) + " manual\"\n";
}

std::string ManOption(const Option& option) {
  std::string text =
      ".TP\n.BI " + Escape("--" + option.name, "-") + " \" " +
      (option.choices.empty() ? option.type : ba::join(option.choices, "|")) +
      "\"\n" + Roff(option.help) + ".\n";
  if (option.is_required) return text + "Required.\n";
  return option.default_text.empty()
             ? text
             : text + "Default: " + Roff(option.default_text) + ".\n";
}

std::string ManExitStatus() {
  return ".SH EXIT STATUS\n0 on success, 1 on failure with its reason on the "
         "standard error, 2 on wrong usage.\n";
}

// Single quotes of a shell.
std::string Quoted(const std::string& text) {
  return "'" + ba::replace_all_copy(text, "'", "'\\''") + "'";
}

std::string ZshOption(const Option& option) {
  const std::vector<std::string> values = Values(option);
  const std::string action = !values.empty() ? "(" + ba::join(values, " ") + ")"
                             : IsPath(option) ? "_files"
                                              : "";
  return Quoted("--" + option.name + "[" + Escape(option.help, "[]:\\") +
                "]:" + option.type + ":" + action);
}

// A cell of a table in Markdown.
std::string Cell(const std::string& text) { return Escape(text, "|<>*_"); }

std::string Code(const std::string& text) {
  return text.empty() ? "" : "`" + text + "`";
}

// The commands of users, in the order of the help text.
CommandDescriptions DescribeCommands() {
  CommandDescriptions descriptions;
  for (const Command& command : Commands()) {
    std::string program = "colmap";
    char* argv[] = {program.data(), nullptr};
    descriptions.push_back(
        DescribeOptions([&] { return command.run(1, argv); }));
    descriptions.back().headline = command.summary;
  }
  return descriptions;
}

// Here and below, `program` is the name that users type.
std::string ProgramManPage(const std::string& program,
                           const CommandDescriptions& commands) {
  std::string text = ManHeading(program, program) + ".SH NAME\n" +
                     Roff(program) +
                     " \\- structure from motion with depth priors\n"
                     ".SH SYNOPSIS\n.B " +
                     program + "\n.I command\n[\\fIoptions\\fR]\n" +
                     ".SH DESCRIPTION\n"
                     "Commands that extend COLMAP by depth priors. All other "
                     "commands are handed to the COLMAP of the machine: the "
                     "one that DGSFM_COLMAP_EXE names, or the first in PATH.\n"
                     ".SH COMMANDS\n";
  for (const CommandDescription& command : commands) {
    text += ".TP\n.B " + command.command + "\n" + Roff(command.headline) +
            ", see\n.BR " + Escape(program + "-" + command.command, "-") +
            " (1)\n";
  }
  return text + ManExitStatus() +
         ".SH ENVIRONMENT\n.TP\n.B DGSFM_COLMAP_EXE\nPath of the COLMAP "
         "program that gets other commands.\n";
}

std::string CommandManPage(const std::string& program,
                           const CommandDescription& command) {
  const std::string name = program + "-" + command.command;
  std::string text = ManHeading(name, program) + ".SH NAME\n" + Roff(name) +
                     " \\- " + Roff(command.headline) + "\n.SH SYNOPSIS\n.B " +
                     program + " " + command.command + "\n";
  for (const Option& option : command.options) {
    if (!option.is_required) continue;
    text += ".BI " + Escape("--" + option.name, "-") + " \" " + option.type +
            "\"\n";
  }
  text += "[\\fIoptions\\fR]\n.SH DESCRIPTION\n" + Roff(command.summary) +
          "\n.SH OPTIONS\n";
  for (const Option& option : command.options) text += ManOption(option);
  return text +
         ".TP\n.BI \\-\\-project_path \" text\"\nFile with options; those of "
         "the command line win.\n.TP\n.BR \\-v \", \" \\-\\-log_level\nLog of "
         "the run: 0 is its story, 1 adds the figures of each stage.\n" +
         ManExitStatus() + ".SH SEE ALSO\n.BR " + program + " (1)\n";
}

std::string BashCompletion(const std::string& program,
                           const CommandDescriptions& commands) {
  std::string names, options, values;
  for (const CommandDescription& command : commands) {
    names += command.command + " ";
    std::string of_command;
    for (const Option& option : command.options) {
      of_command += "--" + option.name + " ";
      const std::string pattern =
          "    " + command.command + ":--" + option.name + ") echo ";
      if (!Values(option).empty()) {
        values += pattern + Quoted(ba::join(Values(option), " ")) + " ;;\n";
      }
    }
    options += "    " + command.command + ") echo " +
               Quoted(of_command + "--project_path --log_level --help") +
               " ;;\n";
  }
  return "# Completion of " + program +
         " in bash, generated from its options.\n\n"
         "_dgsfm_options() {\n  case $1 in\n" +
         options + "  esac\n}\n\n_dgsfm_values() {\n  case $1:$2 in\n" +
         values +
         "  esac\n}\n\n"
         // Other commands are those that the help text lists, read once.
         "_dgsfm_commands() {\n"
         "  if [[ -z ${_dgsfm_command_list:-} ]]; then\n"
         "    _dgsfm_command_list=\"" +
         names +
         "help $(\n"
         "      \"$1\" help 2>/dev/null </dev/null |\n"
         "        sed -nE '/^Available commands/,$s/^ "
         "+([a-z][a-z0-9_]*)$/\\1/p'"
         "\n    )\"\n"
         "  fi\n"
         "}\n\n"
         "_dgsfm() {\n"
         "  local current=${COMP_WORDS[COMP_CWORD]}\n"
         "  local previous=${COMP_WORDS[COMP_CWORD-1]}\n"
         "  local command=${COMP_WORDS[1]} words\n"
         "  COMPREPLY=()\n"
         "  if [[ $COMP_CWORD -eq 1 ]]; then\n"
         "    _dgsfm_commands \"$1\"\n"
         "    words=$_dgsfm_command_list\n"
         "  elif [[ $previous == --* ]]; then\n"
         "    words=$(_dgsfm_values \"$command\" \"$previous\")\n"
         "  else\n"
         "    words=$(_dgsfm_options \"$command\")\n"
         "  fi\n"
         "  [[ -n $words ]] &&\n"
         "    mapfile -t COMPREPLY < <(compgen -W \"$words\" -- \"$current\")\n"
         "  return 0\n}\n\n"
         // Without words, as for paths, the shell offers files.
         "complete -o default -F _dgsfm " +
         program + "\n";
}

std::string ZshCompletion(const std::string& program,
                          const CommandDescriptions& commands) {
  std::string names, cases;
  for (const CommandDescription& command : commands) {
    names += "    " +
             Quoted(command.command + ":" + Escape(command.headline, ":\\")) +
             "\n";
    cases += "    " + command.command + ")\n      _arguments \\\n";
    for (const Option& option : command.options) {
      cases += "        " + ZshOption(option) + " \\\n";
    }
    cases +=
        "        '--project_path[File with options]:file:_files' \\\n"
        "        '--log_level[Details in the log]:level:(0 1)' \\\n"
        "        '--help[Show all options]'\n      ;;\n";
  }
  return "#compdef " + program +
         "\n# Completion in zsh, generated from the options.\n\n_dgsfm() {\n"
         "  local -a commands=(\n" +
         names +
         "    'help:lists all commands'\n  )\n"
         "  if (( CURRENT == 2 )); then\n"
         "    _describe command commands\n    return\n  fi\n"
         "  shift words\n  (( CURRENT-- ))\n  case $words[1] in\n" +
         cases + "    *) _files ;;\n  esac\n}\n\n_dgsfm \"$@\"\n";
}

// A Markdown page.
std::string CommandReference(const std::string& program,
                             const CommandDescriptions& commands) {
  std::string text =
      "# Commands\n\nGenerated from the option definitions of the program. "
      "Flags are 0 or 1. Every command has `--help`, `--project_path` (a file "
      "with options; those of the command line win) and `--log_level` (or "
      "`-v`; 1 adds the figures of each stage to the log). Exit code 0 is "
      "success, 1 a failure with its reason, 2 wrong usage.\n\n"
      "| command | |\n| --- | --- |\n";
  for (const CommandDescription& command : commands) {
    text += "| [" + command.command + "](#" + command.command + ") | " +
            Cell(command.headline) + " |\n";
  }
  for (const CommandDescription& command : commands) {
    text += "\n## " + command.command + "\n\n`" + program + " " +
            command.command + "`: " + Escape(command.summary, "<>*") +
            "\n\n| option | values | default | meaning |\n"
            "| --- | --- | --- | --- |\n";
    for (const Option& option : command.options) {
      text += "| `--" + option.name + "` | " +
              (option.choices.empty() ? option.type
                                      : ba::join(option.choices, ", ")) +
              " | " +
              (option.is_required ? "required" : Code(option.default_text)) +
              " | " + Cell(option.help) + " |\n";
    }
  }
  return text;
}

// An object of command names, each with summary and options.
std::string CommandsJson(const CommandDescriptions& commands) {
  nlohmann::ordered_json json;
  for (const CommandDescription& command : commands) {
    auto& entry = json[command.command];
    entry["summary"] = command.summary;
    entry["headline"] = command.headline;
    for (const Option& option : command.options) {
      entry["options"][option.name] = {{"type", option.type},
                                       {"default", option.default_text},
                                       {"required", option.is_required},
                                       {"choices", option.choices},
                                       {"help", option.help}};
    }
  }
  return JsonText(json, 2) + "\n";
}

}  // namespace

int RunCommandDocuments(int argc, char** argv) {
  std::string output_path;
  std::string program = "colmap";
  CommandOptions options(
      "command_documents",
      "Writes documents that are generated from the options of all commands.");
  options.AddRequired("output_path", &output_path, "folder of the documents");
  options.Add("program", &program, "name of the program in the documents");
  if (const auto exit_code = options.Parse(argc, argv)) return *exit_code;
  const CommandDescriptions commands = DescribeCommands();
  const fs::path folder = output_path;
  CreateOutputFolder((folder / "man1").string());
  const auto write = [&](const fs::path& name, const std::string& text) {
    WriteFile((folder / name).string(), text);
  };
  write("man1/" + program + ".1", ProgramManPage(program, commands));
  for (const CommandDescription& command : commands) {
    write("man1/" + program + "-" + command.command + ".1",
          CommandManPage(program, command));
  }
  write(program + ".bash", BashCompletion(program, commands));
  write("_" + program, ZshCompletion(program, commands));
  write("commands.md", CommandReference(program, commands));
  write("commands.json", CommandsJson(commands));
  return 0;
}

}  // namespace dgsfm
