#include "controllers/commands/command_log.h"

#include <cstdio>
#include <string>

#include <glog/logging.h>

namespace dgsfm {

namespace {

class StderrSink : public google::LogSink {
 public:
  void send(google::LogSeverity severity,
            const char* /*path*/,
            const char* file,
            int line,
            const google::LogMessageTime& time,
            const char* message,
            size_t size) override {
    // glog itself prints what ends the program, with the stack.
    if (severity == google::GLOG_FATAL) return;
    std::string text;
    if (FLAGS_v > 0) {
      char prefix[24];
      std::snprintf(prefix,
                    sizeof(prefix),
                    "%02d:%02d:%02d.%03d ",
                    time.hour(),
                    time.min(),
                    time.sec(),
                    time.usec() / 1000);
      text = prefix + std::string(file) + ":" + std::to_string(line) + " ";
    }
    if (severity != google::GLOG_INFO) {
      text += std::string(google::GetLogSeverityName(severity)) + ": ";
    }
    text.append(message, size);
    text += '\n';
    // One call, so that lines of several threads stay whole.
    std::fwrite(text.data(), 1, text.size(), stderr);
  }
};

}  // namespace

void LogToStderr() {
  // Never destroyed, as other objects may log while the program ends.
  static auto* const sink = new StderrSink;
  for (int severity = 0; severity < google::NUM_SEVERITIES; ++severity) {
    google::SetLogDestination(severity, "");
  }
  FLAGS_logtostderr = false;
  FLAGS_stderrthreshold = google::GLOG_FATAL;
  google::AddLogSink(sink);
}

}  // namespace dgsfm
