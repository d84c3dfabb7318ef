// Documents that are generated from the options of the commands: man pages,
// completions of shells, and lists for the documentation and for tests.

#pragma once

#include "controllers/commands/command_options.h"

#include <string>
#include <vector>

namespace dgsfm {

using CommandDescriptions = std::vector<CommandDescription>;

// The commands of users, in the order of the help text.
CommandDescriptions DescribeCommands();

// `program` is the name that users type.
std::string ProgramManPage(const std::string& program,
                           const CommandDescriptions& commands);
std::string CommandManPage(const std::string& program,
                           const CommandDescription& command);
std::string BashCompletion(const std::string& program,
                           const CommandDescriptions& commands);
std::string ZshCompletion(const std::string& program,
                          const CommandDescriptions& commands);
// A Markdown page.
std::string CommandReference(const std::string& program,
                             const CommandDescriptions& commands);
// An object of command names, each with summary and options.
std::string CommandsJson(const CommandDescriptions& commands);

}  // namespace dgsfm
