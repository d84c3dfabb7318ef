// The page without its data, put together of controllers/report/page when the
// project is built.

#pragma once

namespace dgsfm {

// Has kReportDataMark once, where the data go.
extern const char* const kReportPageTemplate;
constexpr char kReportDataMark[] = "@REPORT_DATA@";

}  // namespace dgsfm
