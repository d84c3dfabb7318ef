#include "sfm/stage_report.h"

#include "colmap_ext/cancellation.h"
#include "colmap_ext/process_memory.h"
#include "sfm/stage_story.h"

#include <sstream>

#include <glog/logging.h>
#include <sys/resource.h>

namespace dgsfm {

namespace {

double CpuSeconds() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& time) {
    return double(time.tv_sec) + 1e-6 * double(time.tv_usec);
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

}  // namespace

StageTimer::StageTimer(const std::string& stage)
    : start_(std::chrono::steady_clock::now()), cpu_start_(CpuSeconds()) {
  ThrowIfCancelled();
  report_.stage = stage;
}

StageTimer& StageTimer::Add(const std::string& figure, double value) {
  report_.figures.emplace_back(figure, value);
  return *this;
}

StageTimer& StageTimer::Add(const PairTotals& totals) {
  for (const auto& [status, count] : totals.num_with_status) {
    Add(PairStatusName(status), double(count));
  }
  for (const auto& [degeneracy, count] : totals.num_valid_with_degeneracy) {
    Add("valid_" + PairDegeneracyName(degeneracy), double(count));
  }
  return *this;
}

void StageTimer::Finish(std::vector<StageReport>* reports) {
  report_.seconds =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start_)
          .count();
  report_.cpu_seconds = CpuSeconds() - cpu_start_;
  report_.peak_memory_mb = PeakMemoryMb();

  std::ostringstream line;
  line << report_.stage << ":";
  for (const auto& [figure, value] : report_.figures) {
    line << " " << figure << "=" << value;
  }
  line << " (" << report_.seconds << " s, " << report_.peak_memory_mb
       << " MB peak)";
  VLOG(1) << line.str();
  reports->push_back(report_);
  for (const std::string& sentence : NextSentences(*reports)) {
    LOG(INFO) << sentence;
  }
}

}  // namespace dgsfm
