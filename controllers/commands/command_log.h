// The log of the executable: plain sentences on stderr.

#pragma once

namespace dgsfm {

// Sends glog's messages to stderr, once glog is initialised, and to no file. A
// message is a line as it stands, after "WARNING: " or "ERROR: " where it is
// one; where details are logged (FLAGS_v > 0) each has time and source before
// it.
void LogToStderr();

}  // namespace dgsfm
