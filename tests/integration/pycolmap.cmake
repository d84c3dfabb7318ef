# Databases with our tables, read by COLMAP 4.x through pycolmap. Skipped where
# the interpreter, DGSFM_PYTHON, has no pycolmap.

if(NOT DGSFM_PYTHON)
  message(STATUS "No Python: the test of databases with pycolmap is left out")
  return()
endif()

add_executable(depth_tables_tool depth_tables_tool.cc)
target_link_libraries(depth_tables_tool PRIVATE colmap_ext dgsfm_warnings)

set(SHARED_DATABASE
    ${PROJECT_SOURCE_DIR}/../shared/data/fountain-P11/database.db)
if(NOT EXISTS ${SHARED_DATABASE})
  set(SHARED_DATABASE)
endif()
add_test(NAME integration.PycolmapReadsDatabasesWithDepth
  COMMAND ${DGSFM_PYTHON}
    ${CMAKE_CURRENT_LIST_DIR}/pycolmap_compat.py
    $<TARGET_FILE:depth_tables_tool>
    ${CMAKE_CURRENT_BINARY_DIR}/pycolmap_compat ${SHARED_DATABASE})
set_tests_properties(integration.PycolmapReadsDatabasesWithDepth PROPERTIES
  LABELS integration SKIP_RETURN_CODE 77)

add_test(NAME integration.RigsOfPycolmapStayRigid
  COMMAND ${CMAKE_COMMAND} -E env COLMAP=$<TARGET_FILE:colmap_main>
    ${DGSFM_PYTHON} ${CMAKE_CURRENT_LIST_DIR}/rig_models.py
    ${CMAKE_CURRENT_BINARY_DIR}/rig_models)
set_tests_properties(integration.RigsOfPycolmapStayRigid PROPERTIES
  LABELS integration SKIP_RETURN_CODE 77)
