# One test for each cell of the table in docs/depth_formats.md: a file written
# by a real tool and read by this program, or the other way round. Skipped where
# DGSFM_PYTHON has not the tool.

set(CLIENTS ${CMAKE_CURRENT_LIST_DIR}/depth_clients.py)
file(STRINGS ${CLIENTS} CELLS REGEX "^    def test_")
foreach(CELL ${CELLS})
  string(REGEX REPLACE "^    def test_([a-z0-9_]+).*" "\\1" CELL ${CELL})
  dgsfm_add_script_test(DepthClients.${CELL}
    ${CMAKE_COMMAND} -E env COLMAP=$<TARGET_FILE:colmap_main>
    ${DGSFM_PYTHON} -B ${CLIENTS} DepthClients.test_${CELL})
endforeach()
add_library(fault_injection MODULE fault_injection.c)
target_link_libraries(fault_injection PRIVATE ${CMAKE_DL_LIBS})
# The script's default are 50 kills.
foreach(COMMAND depth_importer dense_match_importer depth_geometric_verifier)
  dgsfm_add_script_test(Kills.${COMMAND}
    ${CMAKE_COMMAND} -E env COLMAP=$<TARGET_FILE:colmap_main>
    FAULT_LIBRARY=$<TARGET_FILE:fault_injection>
    ASAN_OPTIONS=verify_asan_link_order=0
    ${DGSFM_PYTHON} -B ${CMAKE_CURRENT_LIST_DIR}/importer_kill_test.py
    ${COMMAND} 12)
endforeach()
dgsfm_add_script_test(Model.OtherLoadersReadIt
  ${CMAKE_COMMAND} -E env COLMAP=$<TARGET_FILE:colmap_main>
  ${DGSFM_PYTHON} -B ${CMAKE_CURRENT_LIST_DIR}/model_loaders.py)
dgsfm_add_script_test(EstimateDepth.RunsOnnxModels
  ${DGSFM_PYTHON} -B ${CMAKE_CURRENT_LIST_DIR}/estimate_depth_test.py)
dgsfm_add_script_test(EstimateDepth.CallsModelsAsPublished
  ${CMAKE_COMMAND} -E env COLMAP=$<TARGET_FILE:colmap_main>
  ${DGSFM_PYTHON} -B ${CMAKE_CURRENT_LIST_DIR}/estimate_depth_adapters.py)
dgsfm_add_script_test(Databases.OfEveryColmapAreExtended
  ${CMAKE_COMMAND} -E env COLMAP=$<TARGET_FILE:colmap_main>
  ${DGSFM_PYTHON} -B ${CMAKE_CURRENT_LIST_DIR}/client_databases.py)
# The script samples the calls at which it injects faults; "all" takes each.
foreach(CASE model_renderer model_evaluator depth_exporter depth_exporter_bin
        depth_exporter_3dgs depth_global_mapper threads)
  dgsfm_add_script_test(Faults.OutputIsOldOrNew.${CASE}
    ${CMAKE_COMMAND} -E env COLMAP=$<TARGET_FILE:colmap_main>
    FAULT_LIBRARY=$<TARGET_FILE:fault_injection>
    ASAN_OPTIONS=verify_asan_link_order=0
    ${DGSFM_PYTHON} -B ${CMAKE_CURRENT_LIST_DIR}/output_faults_test.py ${CASE})
endforeach()
# The script's default are 2000 databases and 500 models.
dgsfm_add_script_test(Faults.HostileInputEndsWithAnError
  ${CMAKE_COMMAND} -E env COLMAP=$<TARGET_FILE:colmap_main>
  ${DGSFM_PYTHON} -B ${CMAKE_CURRENT_LIST_DIR}/hostile_input_test.py 20 20)
dgsfm_add_script_test(Mapper.GoesOnAfterAKill
  ${CMAKE_COMMAND} -E env FAULT_LIBRARY=$<TARGET_FILE:fault_injection>
  ASAN_OPTIONS=verify_asan_link_order=0
  ${Python3_EXECUTABLE} -B ${CMAKE_CURRENT_SOURCE_DIR}/mapper_kill_test.py
  $<TARGET_FILE:colmap_main>)
