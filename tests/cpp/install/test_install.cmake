# Installs BUILD below FOLDER, builds the program in SOURCE against that, and runs it.
file(REMOVE_RECURSE "${FOLDER}")

function(step)
  execute_process(COMMAND ${ARGN} RESULT_VARIABLE result OUTPUT_VARIABLE output ERROR_VARIABLE output)
  if(result)
    message(FATAL_ERROR "${ARGN}: ${result}\n${output}")
  endif()
endfunction()

step("${CMAKE_COMMAND}" --install "${BUILD}" --component cpp --prefix "${FOLDER}/prefix")
step("${CMAKE_COMMAND}" -S "${SOURCE}" -B "${FOLDER}/consumer" -G "${GENERATOR}" "-DCMAKE_CXX_COMPILER=${CXX}"
     "-DCMAKE_PREFIX_PATH=${FOLDER}/prefix" "-DSANITIZE=${FLAGS}")
step("${CMAKE_COMMAND}" --build "${FOLDER}/consumer")
step("${FOLDER}/consumer/consumer")
