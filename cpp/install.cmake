# What `cmake --install BUILD --component cpp` lays down for C++ programs: the public headers, the libraries and what
# find_package(sheetsplat) needs. The Python module is the component `python`.
include(CMakePackageConfigHelpers)

get_property(layers GLOBAL PROPERTY SHEETSPLAT_LAYERS)
install(TARGETS sheetsplat sheetsplat_public sheetsplat_glad ${layers} EXPORT sheetsplat ARCHIVE DESTINATION lib COMPONENT cpp)
install(DIRECTORY cpp/include/sheetsplat DESTINATION include COMPONENT cpp)
install(EXPORT sheetsplat NAMESPACE sheetsplat:: FILE targets.cmake DESTINATION lib/cmake/sheetsplat COMPONENT cpp)

set(package_dir ${CMAKE_CURRENT_BINARY_DIR}/generated/package)
write_basic_package_version_file(${package_dir}/sheetsplat-config-version.cmake COMPATIBILITY SameMinorVersion)
install(FILES cpp/sheetsplat-config.cmake ${package_dir}/sheetsplat-config-version.cmake DESTINATION lib/cmake/sheetsplat
        COMPONENT cpp)

if(SHEETSPLAT_BUILD_TESTS)
  # A program outside the tree finds the installed library, sees its public headers and no others, and runs.
  add_test(NAME install.find_package
           COMMAND ${CMAKE_COMMAND} "-DBUILD=${CMAKE_CURRENT_BINARY_DIR}" "-DSOURCE=${CMAKE_CURRENT_SOURCE_DIR}/tests/cpp/install"
                   "-DFOLDER=${CMAKE_CURRENT_BINARY_DIR}/test_install" "-DGENERATOR=${CMAKE_GENERATOR}"
                   "-DCXX=${CMAKE_CXX_COMPILER}" "-DFLAGS=${SHEETSPLAT_SANITIZE}"
                   -P "${CMAKE_CURRENT_SOURCE_DIR}/tests/cpp/install/test_install.cmake")
  set_tests_properties(install.find_package PROPERTIES LABELS unit TIMEOUT 300)
endif()
