# The program, the rooms below it as one library with their public headers, job scripts and
# configurations. PREFIX/lib/cmake/v2v3d is what find_package(v2v3d) reads.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

get_property(folders DIRECTORY ${PROJECT_SOURCE_DIR}/src PROPERTY SUBDIRECTORIES)
set(objects "")
foreach(folder IN LISTS folders)
  get_filename_component(room ${folder} NAME)
  if(NOT room STREQUAL "cli")
    list(APPEND objects $<TARGET_OBJECTS:v2v_${room}>)
  endif()
endforeach()
add_library(v2v3d_library STATIC ${objects})
set_target_properties(v2v3d_library PROPERTIES OUTPUT_NAME v2v3d LINKER_LANGUAGE C)

set(package ${CMAKE_INSTALL_LIBDIR}/cmake/v2v3d)
configure_package_config_file(${CMAKE_CURRENT_LIST_DIR}/v2v3dConfig.cmake.in
  ${PROJECT_BINARY_DIR}/v2v3dConfig.cmake INSTALL_DESTINATION ${package}
  PATH_VARS CMAKE_INSTALL_INCLUDEDIR CMAKE_INSTALL_LIBDIR)
write_basic_package_version_file(${PROJECT_BINARY_DIR}/v2v3dConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(TARGETS v2v3d v2v3d_library RUNTIME ARCHIVE)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/include/v2v3d TYPE INCLUDE)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/jobs ${PROJECT_SOURCE_DIR}/configs
  DESTINATION ${CMAKE_INSTALL_DATADIR}/v2v3d USE_SOURCE_PERMISSIONS)
install(FILES ${PROJECT_BINARY_DIR}/v2v3dConfig.cmake ${PROJECT_BINARY_DIR}/v2v3dConfigVersion.cmake
  ${CMAKE_CURRENT_LIST_DIR}/dependencies.cmake DESTINATION ${package})
