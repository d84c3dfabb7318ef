# dgsfm_add_layer(NAME [LINK lib...]): the library of a layer, from all
# sources of its folder. dgsfm_add_layer_test(NAME): its test binary, from
# tests/NAME.

add_library(dgsfm_warnings INTERFACE)
target_compile_options(dgsfm_warnings INTERFACE -Wall -Wextra -Wshadow
  -Wno-missing-field-initializers
  $<$<BOOL:${DGSFM_WARNINGS_AS_ERRORS}>:-Werror>)

function(dgsfm_add_layer NAME)
  cmake_parse_arguments(LAYER "" "" "LINK" ${ARGN})
  file(GLOB_RECURSE SOURCES CONFIGURE_DEPENDS *.cc *.h)
  list(FILTER SOURCES EXCLUDE REGEX "/main\\.cc$")
  add_library(${NAME} STATIC ${SOURCES})
  target_include_directories(${NAME} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
    $<INSTALL_INTERFACE:include/dgsfm>)
  target_link_libraries(${NAME} PUBLIC ${LAYER_LINK} PRIVATE
    $<BUILD_INTERFACE:dgsfm_warnings>)
endfunction()

function(dgsfm_add_layer_test NAME)
  file(GLOB SOURCES CONFIGURE_DEPENDS ${NAME}/*_test.cc)
  if(NOT SOURCES)
    return()
  endif()
  add_executable(${NAME}_test ${SOURCES})
  target_include_directories(${NAME}_test PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(${NAME}_test PRIVATE ${NAME} testing dgsfm_warnings)
  gtest_discover_tests(${NAME}_test PROPERTIES LABELS ${NAME}
    DISCOVERY_TIMEOUT 60)
endfunction()
