#include "sfm/stage_story.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>

namespace dgsfm {

namespace {

// Consecutive reports of one chapter.
class Reports {
 public:
  Reports(const StageReport* begin, const StageReport* end)
      : begin_(begin), end_(end) {}

  // The last value of a figure in reports of any stage, or of the one named.
  std::optional<double> Find(const std::string& figure,
                             const std::string& stage = "") const {
    std::optional<double> found;
    for (const StageReport* report = begin_; report != end_; ++report) {
      if (!stage.empty() && report->stage != stage) continue;
      for (const auto& [name, value] : report->figures) {
        if (name == figure) found = value;
      }
    }
    return found;
  }
  size_t Count(const std::string& figure, const std::string& stage = "") const {
    return static_cast<size_t>(Find(figure, stage).value_or(0));
  }
  size_t Sum(const std::string& figure) const {
    size_t sum = 0;
    for (const StageReport* report = begin_; report != end_; ++report) {
      sum += Reports(report, report + 1).Count(figure);
    }
    return sum;
  }
  double Seconds() const {
    double seconds = 0;
    for (const StageReport* report = begin_; report != end_; ++report) {
      seconds += report->seconds;
    }
    return seconds;
  }
  size_t size() const { return end_ - begin_; }
  const StageReport* begin() const { return begin_; }
  const StageReport* end() const { return end_; }

 private:
  const StageReport* begin_;
  const StageReport* end_;
};

std::string Number(const char* format, double value) {
  char text[32];
  std::snprintf(text, sizeof(text), format, value);
  return text;
}

// Nothing where the count is zero.
std::string IfAny(size_t count,
                  const std::string& noun,
                  const std::string& text) {
  return count == 0 ? "" : "; " + CountText(count, noun) + " " + text;
}

std::string DescribeScene(const Reports& reports) {
  return "Database: " + CountText(reports.Count("images"), "image") + ", " +
         CountText(reports.Count("pairs"), "matched pair") + ", " +
         CountText(reports.Count("cameras"), "camera") + " (" +
         std::to_string(reports.Count("cameras_calibrated")) + " calibrated, " +
         std::to_string(reports.Count("cameras_with_exif")) +
         " with a focal length of EXIF data)";
}

std::string DescribeDepth(const Reports& reports) {
  const size_t num_images = reports.Count("images");
  return num_images == 0 ? "Depth: none"
                         : "Depth: maps of " + CountText(num_images, "image");
}

std::string DescribeMemory(const Reports& reports) {
  return "Memory: about " +
         Number("%.1f", reports.Find("predicted_gb").value_or(0)) +
         " GB in the end";
}

// Names of statuses are those of PairStatusName.
std::string WithSpaces(std::string name) {
  std::replace(name.begin(), name.end(), '_', ' ');
  return name;
}

std::string DescribePairs(const Reports& reports) {
  size_t num_pairs = 0;
  std::string reasons;
  for (const auto& [figure, value] : reports.begin()->figures) {
    const bool is_status = figure != "kept" && figure != "deleted" &&
                           figure != "restarted" &&
                           figure.rfind("valid_", 0) != 0;
    if (!is_status) continue;
    num_pairs += static_cast<size_t>(value);
    if (figure == "valid") continue;
    reasons += (reasons.empty() ? "; " : ", ") +
               std::to_string(static_cast<size_t>(value)) + " " +
               WithSpaces(figure);
  }
  return "Pairs: " + std::to_string(reports.Count("valid")) + " of " +
         std::to_string(num_pairs) + " valid" + reasons +
         IfAny(reports.Count("kept"), "pair", "verified before") +
         IfAny(reports.Count("deleted"),
               "stored result",
               "deleted, as matches, depths or options changed") +
         IfAny(reports.Count("restarted"),
               "stored result",
               "deleted, as all pairs were to be verified again (restart)");
}

// Pairs that filters of the view graph took out, by status.
std::string DescribeFiltered(const Reports& reports) {
  std::string text;
  for (const StageReport& report : reports) {
    for (const auto& [figure, count] : report.figures) {
      if (figure.rfind(kFilteredPrefix, 0) != 0) continue;
      text +=
          IfAny(static_cast<size_t>(count),
                "pair",
                "left out (" +
                    WithSpaces(figure.substr(kFilteredPrefix.size())) + ")");
    }
  }
  return text;
}

std::string DescribeCameras(const Reports& reports) {
  std::string sources;
  for (const StageReport& report : reports) {
    if (report.stage != "focal_averaging") continue;
    for (const auto& [source, count] : report.figures) {
      sources += (sources.empty() ? "" : ", ") +
                 CountText(static_cast<size_t>(count), "camera") + " by " +
                 WithSpaces(source);
    }
  }
  return "Focal lengths: " + (sources.empty() ? "as given" : sources) +
         IfAny(reports.Count("pairs_verified", "reverification"),
               "pair",
               "verified with these") +
         IfAny(reports.Count("groups", "static_background"),
               "group",
               "of key points at rest left out") +
         IfAny(reports.Count("maps_dropped"), "depth map", "left out") +
         DescribeFiltered(reports);
}

std::string DescribeRotations(const Reports& reports) {
  return "Rotations: " + std::to_string(reports.Count("images_kept")) + " of " +
         CountText(reports.Count("images"), "image") +
         IfAny(reports.Count("pairs_filtered"), "pair", "left out") +
         IfAny(reports.Count("pairs_recovered"), "pair", "found again");
}

std::string DescribeInitialization(const Reports& reports) {
  return "First positions: " +
         CountText(reports.Count("images", "initialization"), "image") + ", " +
         CountText(reports.Count("tracks"), "track") +
         (reports.Count("tracks_established") > 0
              ? " of " + CountText(reports.Count("tracks_established"), "track")
              : "") +
         IfAny(reports.Count("pairs_filtered", "translation_averaging"),
               "pair",
               "left out");
}

std::string DescribePositioning(const Reports& reports) {
  return "Global positioning: " + CountText(reports.Count("points"), "point") +
         IfAny(reports.Count("observations_filtered"),
               "observation",
               "left out") +
         (reports.Count("converged") > 0 ? "" : "; not converged");
}

std::string DescribeAdjustment(const Reports& reports) {
  return "Bundle adjustment: " + CountText(reports.size(), "round") + ", " +
         CountText(reports.Count("points"), "point") + ", error " +
         Number("%.2f", reports.Find("rms_px").value_or(0)) + " px rms" +
         IfAny(reports.Sum("observations_filtered"), "observation", "left out");
}

std::string DescribeOneCenter(const Reports& reports) {
  return std::string("Little parallax: ") +
         (reports.Count("kept") > 0
              ? "the model that grew from one centre stays"
              : "the model stays as it started from pairs") +
         (reports.Count("held") > 0 ? "; its images share one centre" : "");
}

std::string DescribeCalibration(const Reports& reports) {
  const size_t num_cameras = reports.Count("cameras");
  return "Self-calibration: " +
         (num_cameras == 0 ? std::string("each camera by itself")
                           : CountText(num_cameras, "camera") + " tied in " +
                                 CountText(reports.Count("groups"), "group")) +
         IfAny(reports.Count("principal_points_held"),
               "principal point",
               "held") +
         IfAny(reports.Count("distortions_held"), "distortion", "held");
}

std::string DescribeCompletion(const Reports& reports) {
  return "Completion: " +
         CountText(reports.Sum("observations_gained"), "observation") +
         " gained, " +
         CountText(reports.Sum("observations_filtered"), "observation") +
         " left out, " + CountText(reports.Count("points"), "point") +
         ", error " + Number("%.2f", reports.Find("rms_px").value_or(0)) +
         " px rms" +
         IfAny(reports.Sum("images_moved") + reports.Sum("images_registered"),
               "image",
               "placed anew");
}

std::string DescribeScale(const Reports& reports) {
  if (reports.Count("scale_by_rigs") > 0) {
    return "Scale: that of the rigs' baselines";
  }
  const size_t num_images = reports.Count("images_with_scale");
  if (num_images == 0) return "Scale: arbitrary, as no depth map gives it";
  return "Scale: that of " + CountText(num_images, "depth map") +
         ", which differ by " +
         Number(
             "%.0f",
             100 * std::expm1(reports.Find("log_scale_spread").value_or(0))) +
         " %";
}

std::string DescribeWriting(const Reports& reports) {
  return "Wrote " + CountText(reports.Count("models"), "model");
}

// Stages that one sentence describes.
struct Chapter {
  std::vector<std::string> stages;
  // Its last stage, after which the sentence is due; empty if there may be
  // more of them, so that only the next chapter shows the end.
  std::string last_stage;
  // Whether models after the first do without it.
  bool is_of_model;
  std::function<std::string(const Reports&)> describe;
};

const std::vector<Chapter>& Chapters() {
  static const std::vector<Chapter> chapters = {
      {{"load_scene"}, "load_scene", false, &DescribeScene},
      {{"load_depth"}, "load_depth", false, &DescribeDepth},
      {{"pair_verification"}, "pair_verification", false, &DescribePairs},
      {{"memory_prediction"}, "memory_prediction", false, &DescribeMemory},
      {{"static_background",
        "depth_reliability",
        "view_graph_filter",
        "focal_averaging",
        "reverification"},
       "reverification",
       false,
       &DescribeCameras},
      {{"rotation_averaging", "rotation_recovery"},
       "",
       true,
       &DescribeRotations},
      {{"scale_averaging", "translation_averaging", "initialization"},
       "initialization",
       true,
       &DescribeInitialization},
      {{"global_positioning"},
       "global_positioning",
       true,
       &DescribePositioning},
      {{"bundle_adjustment"}, "", true, &DescribeAdjustment},
      {{"start_from_one_center", "one_center"},
       "one_center",
       true,
       &DescribeOneCenter},
      {{"self_calibration"}, "self_calibration", true, &DescribeCalibration},
      {{"retriangulation", "final_adjustment"}, "", true, &DescribeCompletion},
      {{"metric_scale"}, "metric_scale", true, &DescribeScale},
      {{"write_models"}, "write_models", false, &DescribeWriting},
  };
  return chapters;
}

// Nothing for stages without a chapter, which are details.
const Chapter* ChapterOf(const StageReport& report) {
  for (const Chapter& chapter : Chapters()) {
    if (std::count(chapter.stages.begin(), chapter.stages.end(), report.stage) >
        0) {
      return &chapter;
    }
  }
  return nullptr;
}

// The reports of a chapter that ends before `end`.
Reports ReportsOfChapter(const std::vector<StageReport>& reports,
                         size_t end,
                         const Chapter* chapter) {
  size_t begin = end;
  while (begin > 0 && ChapterOf(reports[begin - 1]) == chapter) --begin;
  return Reports(reports.data() + begin, reports.data() + end);
}

// Sentences of stages that take hardly any time go without it.
std::string WithTime(const std::string& sentence, const Reports& reports) {
  const std::string duration = DurationText(reports.Seconds());
  return duration == "0.0 s" ? sentence : sentence + " (" + duration + ")";
}

// The one sentence of a model after the first.
std::string DescribeModel(const std::vector<StageReport>& reports,
                          size_t num_models) {
  size_t begin = reports.size() - 1;
  while (begin > 0 && reports[begin].stage != "rotation_averaging") --begin;
  const Reports of_model(reports.data() + begin,
                         reports.data() + reports.size());
  return WithTime(
      "Model " + std::to_string(num_models) + ": " +
          CountText(of_model.Count("images", "metric_scale"), "image") + ", " +
          CountText(of_model.Count("points", "metric_scale"), "point"),
      of_model);
}

}  // namespace

std::vector<std::string> NextSentences(
    const std::vector<StageReport>& reports) {
  std::vector<std::string> sentences;
  if (reports.empty()) return sentences;
  const size_t size = reports.size();
  const Chapter* chapter = ChapterOf(reports.back());
  const size_t num_models = static_cast<size_t>(
      std::count_if(reports.begin(), reports.end(), [](const auto& report) {
        return report.stage == "metric_scale";
      }));
  const bool is_over = reports.back().stage == "metric_scale";
  const bool is_first = num_models == 0 || (num_models == 1 && is_over);
  const auto add = [&](const Chapter* added, size_t end) {
    if (added == nullptr || (added->is_of_model && !is_first)) return;
    const Reports of_chapter = ReportsOfChapter(reports, end, added);
    sentences.push_back(WithTime(added->describe(of_chapter), of_chapter));
  };
  if (size > 1) {
    const StageReport& previous = reports[size - 2];
    const Chapter* before = ChapterOf(previous);
    if (before != nullptr && before != chapter &&
        previous.stage != before->last_stage) {
      add(before, size - 1);
    }
  }
  if (is_over && !is_first) {
    sentences.push_back(DescribeModel(reports, num_models));
  } else if (chapter != nullptr &&
             reports.back().stage == chapter->last_stage) {
    add(chapter, size);
  }
  return sentences;
}

std::string DurationText(double seconds) {
  if (seconds < 10) return Number("%.1f s", seconds);
  const auto whole = static_cast<int64_t>(std::lround(seconds));
  if (whole < 120) return std::to_string(whole) + " s";
  return std::to_string(whole / 60) + " min " + std::to_string(whole % 60) +
         " s";
}

std::string CountText(size_t count, const std::string& noun) {
  std::string digits = std::to_string(count);
  for (int i = static_cast<int>(digits.size()) - 3; i > 0; i -= 3) {
    digits.insert(i, ",");
  }
  return digits + " " + noun + (count == 1 ? "" : "s");
}

}  // namespace dgsfm
