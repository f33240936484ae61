# Mesa chooses its driver once a process. softpipe is the one that has depth bounds, and stops at OpenGL 3.3, so that every test runs on it
# again: with GLSL 3.30, glTexImage2D and no texture barrier.
sheetsplat_run(test_gl gl.on_softpipe.depth_bounds LABELS gl VARIABLES GTEST_FILTER=DepthBounds.*
               GALLIUM_DRIVER=softpipe LIBGL_ALWAYS_SOFTWARE=1)
sheetsplat_run(test_gl gl.on_softpipe.device_layer LABELS gl VARIABLES "GTEST_FILTER=-DepthBounds.*:*Lifetime*"
               GALLIUM_DRIVER=softpipe LIBGL_ALWAYS_SOFTWARE=1)
# Where the driver is another one after all, that is no success.
set_property(TEST gl.on_softpipe.depth_bounds PROPERTY SKIP_REGULAR_EXPRESSION "\\[  SKIPPED \\]")
