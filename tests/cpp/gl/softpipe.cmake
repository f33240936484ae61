# Mesa chooses its driver once a process. softpipe is the one that has depth bounds, and stops at OpenGL 3.3, so that every test runs on it
# again: with GLSL 3.30, glTexImage2D and no texture barrier.
foreach(part depth_bounds device_layer)
  add_test(NAME gl.on_softpipe.${part} COMMAND test_gl)
  set_tests_properties(
    gl.on_softpipe.${part} PROPERTIES LABELS gl TIMEOUT 600 ENVIRONMENT "GALLIUM_DRIVER=softpipe;LIBGL_ALWAYS_SOFTWARE=1")
endforeach()
set_property(TEST gl.on_softpipe.depth_bounds APPEND PROPERTY ENVIRONMENT "GTEST_FILTER=DepthBounds.*")
set_property(TEST gl.on_softpipe.device_layer APPEND PROPERTY ENVIRONMENT "GTEST_FILTER=-DepthBounds.*:*Lifetime*")
# Where the driver is another one after all, that is no success.
set_property(TEST gl.on_softpipe.depth_bounds PROPERTY SKIP_REGULAR_EXPRESSION "\\[  SKIPPED \\]")
