# Installs BUILD_DIR into WORK_DIR, then configures, builds and runs the
# program in SOURCE_DIR against the installation.

file(REMOVE_RECURSE ${WORK_DIR})
function(run)
  execute_process(COMMAND ${ARGV} OUTPUT_VARIABLE OUTPUT ERROR_VARIABLE OUTPUT
                  RESULT_VARIABLE RESULT)
  if(RESULT)
    message(FATAL_ERROR "${ARGV}: ${RESULT}\n${OUTPUT}")
  endif()
endfunction()

run(${CMAKE_COMMAND} --install ${BUILD_DIR} --prefix ${WORK_DIR}/prefix)
# Moved, as a package must not depend on where it was first installed.
file(RENAME ${WORK_DIR}/prefix ${WORK_DIR}/moved)
run(${CMAKE_COMMAND} -S ${SOURCE_DIR} -B ${WORK_DIR}/build -G ${GENERATOR}
    -D CMAKE_PREFIX_PATH=${WORK_DIR}/moved -D CMAKE_CXX_COMPILER=${COMPILER}
    -D CMAKE_CXX_FLAGS=${FLAGS})
run(${CMAKE_COMMAND} --build ${WORK_DIR}/build)
run(${WORK_DIR}/build/consumer)
run(${WORK_DIR}/moved/bin/colmap depth_importer --help)
