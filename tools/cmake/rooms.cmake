# v2v_room(NAME [ROOMS room...] [LIBRARIES target...])
#   One static library v2v_NAME out of every .c file of this folder. ROOMS are the rooms that it may
#   include (tests/lint checks the includes against them), LIBRARIES the outside ones that it alone
#   may see.
add_library(v2v_flags INTERFACE)
target_include_directories(v2v_flags INTERFACE ${PROJECT_SOURCE_DIR}/include ${PROJECT_SOURCE_DIR}/src)
target_compile_definitions(v2v_flags INTERFACE _GNU_SOURCE V2V_VERSION="${PROJECT_VERSION}")
# -ffp-contract=fast: fused multiply-adds where the processor has them. NaN and Inf keep their
# meaning: no -ffast-math.
target_compile_options(v2v_flags INTERFACE
  -Wall -Wextra -Wshadow -Wstrict-prototypes -Wmissing-prototypes -Wvla -Wpointer-arith
  -Wwrite-strings -Wundef -Wformat=2 -Wcast-qual -Wno-unknown-pragmas
  -ffp-contract=fast -fno-math-errno -fno-trapping-math)
target_link_libraries(v2v_flags INTERFACE OpenMP::OpenMP_C m)
if(CMAKE_BUILD_TYPE STREQUAL "Release")
  target_compile_options(v2v_flags INTERFACE -O3)
endif()
if(V2V_WERROR)
  target_compile_options(v2v_flags INTERFACE -Werror)
endif()
if(V2V_FAULTS)
  target_compile_definitions(v2v_flags INTERFACE V2V_FAULTS=1)
endif()
if(V2V_SANITIZE)
  target_compile_options(v2v_flags INTERFACE -fsanitize=address,undefined -fno-omit-frame-pointer
    -fno-sanitize-recover=undefined -fno-sanitize=pointer-overflow)
  target_link_options(v2v_flags INTERFACE -fsanitize=address,undefined)
endif()
if(V2V_ANALYZE)
  target_compile_options(v2v_flags INTERFACE -fanalyzer)
endif()
if(V2V_COVERAGE)
  target_compile_options(v2v_flags INTERFACE --coverage)
  target_link_options(v2v_flags INTERFACE --coverage)
endif()

function(v2v_room name)
  cmake_parse_arguments(ARG "" "" "ROOMS;LIBRARIES" ${ARGN})
  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.c)
  add_library(v2v_${name} STATIC ${sources})
  target_link_libraries(v2v_${name} PUBLIC v2v_flags)
  foreach(room IN LISTS ARG_ROOMS)
    target_link_libraries(v2v_${name} PUBLIC v2v_${room})
  endforeach()
  target_link_libraries(v2v_${name} PRIVATE ${ARG_LIBRARIES})
endfunction()
