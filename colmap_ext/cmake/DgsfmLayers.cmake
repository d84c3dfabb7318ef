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
  add_library(dgsfm::${NAME} ALIAS ${NAME})
  target_compile_features(${NAME} PUBLIC cxx_std_17)
  target_include_directories(${NAME} PUBLIC
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
    $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}/dgsfm>)
  target_link_libraries(${NAME} PUBLIC ${LAYER_LINK} PRIVATE
    $<BUILD_INTERFACE:dgsfm_warnings>)
  # A library "estimators" of ours must not be taken for somebody else's.
  set_target_properties(${NAME} PROPERTIES OUTPUT_NAME dgsfm_${NAME})
  install(TARGETS ${NAME} EXPORT dgsfm
          ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}
          DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}/dgsfm
          FILES_MATCHING PATTERN "*.h" PATTERN "cmake" EXCLUDE)
endfunction()

function(dgsfm_add_layer_test NAME)
  file(GLOB_RECURSE SOURCES CONFIGURE_DEPENDS ${NAME}/*.cc)
  if(NOT SOURCES)
    return()
  endif()
  add_executable(${NAME}_test ${SOURCES})
  target_include_directories(${NAME}_test PRIVATE ${PROJECT_SOURCE_DIR})
  target_link_libraries(${NAME}_test PRIVATE ${NAME} testing dgsfm_warnings)
  gtest_discover_tests(${NAME}_test PROPERTIES LABELS ${NAME}
    DISCOVERY_TIMEOUT 60)
endfunction()
