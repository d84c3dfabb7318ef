# Puts the files of page/ and three.js together to one page and compiles it in.
# Run as a script (-P) it writes OUTPUT from PAGE, STYLE, LIBRARY and SCRIPTS.

if(NOT CMAKE_SCRIPT_MODE_FILE)
  set(PAGE_FOLDER ${CMAKE_CURRENT_SOURCE_DIR}/report/page)
  set(THREE_FOLDER ${PROJECT_SOURCE_DIR}/third_party/three)
  # A script uses what those before it define.
  set(PAGE_SCRIPTS words.js elements.js data.js charts.js frusta.js scene.js
                   selection.js matrix.js tables.js sections.js main.js)
  list(TRANSFORM PAGE_SCRIPTS PREPEND ${PAGE_FOLDER}/)
  set(PAGE_SOURCE ${CMAKE_CURRENT_BINARY_DIR}/page_template.cc)
  add_custom_command(
    OUTPUT ${PAGE_SOURCE}
    COMMAND ${CMAKE_COMMAND} -D PAGE=${PAGE_FOLDER}/index.html
            -D STYLE=${PAGE_FOLDER}/style.css
            -D LIBRARY=${THREE_FOLDER}/three.min.js
            -D LICENSE=${THREE_FOLDER}/LICENSE
            -D "SCRIPTS=${PAGE_SCRIPTS}" -D OUTPUT=${PAGE_SOURCE}
            -P ${CMAKE_CURRENT_LIST_FILE}
    DEPENDS ${PAGE_FOLDER}/index.html ${PAGE_FOLDER}/style.css
            ${THREE_FOLDER}/three.min.js ${THREE_FOLDER}/LICENSE
            ${PAGE_SCRIPTS} ${CMAKE_CURRENT_LIST_FILE}
    COMMENT "Putting the report page together" VERBATIM)
  target_sources(controllers PRIVATE ${PAGE_SOURCE})
  return()
endif()

set(LIBRARY_SHA256
    b9d65ddb208a15748b947757dc00f0ec0c47e2ab8a8cf834fb34ad33721690c2)
file(SHA256 ${LIBRARY} SHA256)
if(NOT SHA256 STREQUAL LIBRARY_SHA256)
  message(FATAL_ERROR "${LIBRARY} is not what third_party/three/vendor.sh "
          "makes: its SHA-256 is ${SHA256}, not ${LIBRARY_SHA256}")
endif()

set(SCRIPT "")
foreach(FILE ${SCRIPTS})
  file(READ ${FILE} TEXT)
  string(APPEND SCRIPT "${TEXT}")
endforeach()
file(READ ${PAGE} PAGE)
foreach(PART STYLE LIBRARY LICENSE)
  file(READ ${${PART}} ${PART})
endforeach()
# These would end the element, or the literal, that they are in.
foreach(PART SCRIPT LIBRARY STYLE)
  if("${${PART}}" MATCHES "</(script|style)|\\)page\"")
    message(FATAL_ERROR "A part of the page has ${CMAKE_MATCH_0} in it")
  endif()
endforeach()
foreach(PART STYLE LICENSE LIBRARY SCRIPT)
  string(REPLACE "@${PART}@" "${${PART}}" PAGE "${PAGE}")
endforeach()
file(WRITE ${OUTPUT} "#include \"controllers/report/page_template.h\"

namespace dgsfm {

const char* const kReportPageTemplate = R\"page(${PAGE})page\";

}  // namespace dgsfm
")
