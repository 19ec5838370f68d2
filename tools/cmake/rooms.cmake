# v2v_room(NAME [ROOMS room...] [HEADERS room/header.h...] [LIBRARIES target...])
#   One static library v2v_NAME out of every .c file of this folder. ROOMS are the rooms whose public
#   headers it may include, added before it, HEADERS private headers that another room shares with it,
#   LIBRARIES the outside ones that it alone may see. Each room has folders of its own in the build
#   tree that lead to its headers, and is compiled with the folders of its ROOMS alone: any other
#   include does not compile (tests/lint/rooms.sh).
add_library(v2v_flags INTERFACE)
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

# Private headers of a room, for its own sources and for programs that are part of it.
function(v2v_see_private target room)
  target_include_directories(${target} PRIVATE ${PROJECT_BINARY_DIR}/rooms/${room}/private)
endfunction()

function(v2v_room name)
  cmake_parse_arguments(ARG "" "" "ROOMS;HEADERS;LIBRARIES" ${ARGN})
  set(folder ${PROJECT_BINARY_DIR}/rooms/${name})
  file(REMOVE_RECURSE ${folder})
  file(MAKE_DIRECTORY ${folder}/public/v2v3d ${folder}/private)
  file(CREATE_LINK ${PROJECT_SOURCE_DIR}/include/v2v3d/${name} ${folder}/public/v2v3d/${name} SYMBOLIC)
  file(CREATE_LINK ${CMAKE_CURRENT_SOURCE_DIR} ${folder}/private/${name} SYMBOLIC)
  foreach(header IN LISTS ARG_HEADERS)
    cmake_path(GET header PARENT_PATH other)
    file(MAKE_DIRECTORY ${folder}/private/${other})
    file(CREATE_LINK ${PROJECT_SOURCE_DIR}/src/${header} ${folder}/private/${header} SYMBOLIC)
  endforeach()

  file(GLOB sources CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.c)
  add_library(v2v_${name} STATIC ${sources})
  target_include_directories(v2v_${name} PUBLIC $<BUILD_INTERFACE:${folder}/public>)
  v2v_see_private(v2v_${name} ${name})
  target_link_libraries(v2v_${name} PUBLIC v2v_flags)
  foreach(room IN LISTS ARG_ROOMS)
    if(NOT TARGET v2v_${room})
      message(FATAL_ERROR "room ${name} names ${room}, which is not below it")
    endif()
    target_link_libraries(v2v_${name} PRIVATE v2v_${room})
  endforeach()
  target_link_libraries(v2v_${name} PRIVATE ${ARG_LIBRARIES})
endfunction()
