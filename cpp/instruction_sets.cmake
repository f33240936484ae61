# Which instruction sets the loops over pixels are compiled for: SHEETSPLAT_CPU_SETS as a list, and a source a set.

if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64|amd64")
  set(known AVX512 AVX2 SSE4)
  # What NumPy needs too. Code outside of the loops is compiled for it.
  add_compile_options(-msse4.2)
elseif(CMAKE_SYSTEM_PROCESSOR MATCHES "aarch64|arm64")
  set(known NEON)
else()
  set(known BASELINE)
endif()
# The names that Highway has for them.
set(target_SSE4 HWY_SSE4)
set(target_AVX2 HWY_AVX2)
set(target_AVX512 HWY_AVX3)
set(target_NEON HWY_NEON)
set(target_BASELINE HWY_STATIC_TARGET)
# What else a source that is compiled for one of them would be compiled for.
set(others_SSE4 "|HWY_AVX2|HWY_AVX3")
set(others_AVX2 "|HWY_AVX3")
set(others_AVX512 "|HWY_AVX2")

set(sheetsplat_cpu_sets ${SHEETSPLAT_CPU_SETS})
if(SHEETSPLAT_CPU_SETS STREQUAL "native" AND known MATCHES AVX2 AND NOT CMAKE_CROSSCOMPILING)
  file(WRITE ${CMAKE_BINARY_DIR}/native_set.cpp "#include <cstdio>\n#define HAS(set) (__builtin_cpu_supports(set) != 0)\nint main() {
    const bool avx2 = HAS(\"avx2\") && HAS(\"fma\") && HAS(\"bmi\") && HAS(\"bmi2\");
    const bool avx512 = avx2 && HAS(\"avx512f\") && HAS(\"avx512vl\") && HAS(\"avx512dq\") && HAS(\"avx512bw\") && HAS(\"avx512cd\");
    std::puts(avx512 ? \"AVX512\" : avx2 ? \"AVX2\" : \"SSE4\");\n}\n")
  try_run(ran compiled ${CMAKE_BINARY_DIR}/native_set ${CMAKE_BINARY_DIR}/native_set.cpp RUN_OUTPUT_VARIABLE native)
  string(STRIP "${native}" sheetsplat_cpu_sets)
elseif(SHEETSPLAT_CPU_SETS MATCHES "^(all|native)$")
  set(sheetsplat_cpu_sets ${known})
endif()
set(sheetsplat_other_sets "")
foreach(set ${sheetsplat_cpu_sets})
  if(NOT set IN_LIST known)
    message(FATAL_ERROR "SHEETSPLAT_CPU_SETS holds ${set}. Wanted: all, native, or some of: ${known}")
  endif()
endforeach()
foreach(set AVX2 AVX512)
  if(NOT set IN_LIST sheetsplat_cpu_sets)
    string(APPEND sheetsplat_other_sets "|${target_${set}}")
  endif()
endforeach()
message(STATUS "Instruction sets: ${sheetsplat_cpu_sets}")

# Adds the loop over a tile to a target: a source for each number type and instruction set.
function(sheetsplat_tile_sources target)
  set(sources)
  foreach(set ${sheetsplat_cpu_sets})
    string(TOLOWER ${set} name)
    foreach(type float double)
      set(source ${CMAKE_CURRENT_BINARY_DIR}/generated/tile_${type}_${name}.cpp)
      file(CONFIGURE OUTPUT ${source} CONTENT
"// Made by cpp/instruction_sets.cmake.
#undef HWY_DISABLED_TARGETS
#define HWY_DISABLED_TARGETS (SHEETSPLAT_DISABLED_TARGETS${others_${set}})
#define SHEETSPLAT_TILE_TYPE ${type}
#define SHEETSPLAT_TILE_SET ${name}
#define SHEETSPLAT_TILE_TARGET ${target_${set}}
#include \"tile_set.hpp\"
")
      list(APPEND sources ${source})
    endforeach()
  endforeach()
  target_sources(${target} PRIVATE ${sources})
  set(tile_sources ${sources} PARENT_SCOPE)
endfunction()
