# Every outside library as one target v2v_NAME; a room names the ones it may see. Each is looked for
# by CMake's own module, by pkg-config and by its header and library, in this order; what is missing
# is named at the end, all of it. Installed beside the package's configuration, which finds the same.
find_package(PkgConfig QUIET)
find_package(OpenMP QUIET COMPONENTS C)
set(v2v_missing "")
if(NOT TARGET OpenMP::OpenMP_C)
  list(APPEND v2v_missing "OpenMP: a C compiler with -fopenmp")
endif()

# v2v_library(NAME TITLE text DEBIAN package [TARGET t] [MODULES m...] [HEADER h [SUFFIX folder] LIBRARIES l...])
#   TARGET: what CMake's module made, of v2v_NAME_version. MODULES: names to pkg-config, the first
#   that it knows. LIBRARIES: of HEADER, which may lie in a folder of its own.
function(v2v_library name)
  cmake_parse_arguments(ARG "" "TITLE;DEBIAN;TARGET;HEADER;SUFFIX" "MODULES;LIBRARIES" ${ARGN})
  add_library(v2v_${name} INTERFACE)
  if(ARG_TARGET AND TARGET ${ARG_TARGET})
    target_link_libraries(v2v_${name} INTERFACE ${ARG_TARGET})
    return()
  endif()
  foreach(module IN LISTS ARG_MODULES)
    if(PkgConfig_FOUND)
      pkg_check_modules(V2V_${module} QUIET IMPORTED_TARGET ${module})
    endif()
    if(TARGET PkgConfig::V2V_${module})
      target_link_libraries(v2v_${name} INTERFACE PkgConfig::V2V_${module})
      set(v2v_${name}_version ${V2V_${module}_VERSION} PARENT_SCOPE)
      return()
    endif()
  endforeach()
  set(v2v_${name}_version "?" PARENT_SCOPE)
  set(found ${ARG_HEADER})
  if(ARG_HEADER)
    find_path(V2V_${name}_INCLUDE ${ARG_HEADER} PATH_SUFFIXES ${ARG_SUFFIX})
    mark_as_advanced(V2V_${name}_INCLUDE)
    set(found ${V2V_${name}_INCLUDE})
    target_include_directories(v2v_${name} INTERFACE ${V2V_${name}_INCLUDE})
  endif()
  foreach(library IN LISTS ARG_LIBRARIES)
    find_library(V2V_${library}_LIBRARY ${library})
    mark_as_advanced(V2V_${library}_LIBRARY)
    if(NOT V2V_${library}_LIBRARY)
      set(found "")
    endif()
    target_link_libraries(v2v_${name} INTERFACE ${V2V_${library}_LIBRARY})
  endforeach()
  if(NOT found)
    list(APPEND v2v_missing "${ARG_TITLE} (Debian: ${ARG_DEBIAN})")
    set(v2v_missing "${v2v_missing}" PARENT_SCOPE)
  endif()
endfunction()

# Ends the configuration if anything was not found.
function(v2v_libraries_found)
  if(v2v_missing)
    list(JOIN v2v_missing "\n  " text)
    message(FATAL_ERROR "v2v3d needs libraries that neither CMake's modules nor pkg-config nor the "
      "compiler's folders have:\n  ${text}\nCMAKE_PREFIX_PATH and PKG_CONFIG_PATH name other places.")
  endif()
endfunction()

set(MPI_DETERMINE_LIBRARY_VERSION ON)
find_package(MPI QUIET COMPONENTS C)
string(REGEX REPLACE "[,\n].*" "" v2v_mpi_version "${MPI_C_LIBRARY_VERSION_STRING}")
v2v_library(mpi TITLE "MPI" DEBIAN libopenmpi-dev TARGET MPI::MPI_C MODULES ompi-c mpich mpi-c)

# A serial HDF5 that comes first in the path is not the one.
set(HDF5_PREFER_PARALLEL ON)
find_package(HDF5 QUIET COMPONENTS C)
set(v2v_hdf5_version ${HDF5_VERSION})
if(HDF5_FOUND AND HDF5_IS_PARALLEL)
  set(v2v_hdf5_target hdf5::hdf5)
endif()
v2v_library(hdf5 TITLE "HDF5 built with MPI" DEBIAN libhdf5-openmpi-dev TARGET ${v2v_hdf5_target}
  MODULES hdf5-openmpi hdf5-mpich hdf5-mpi)

find_package(TIFF QUIET)
set(v2v_tiff_version ${TIFF_VERSION_STRING})
v2v_library(tiff TITLE "libtiff" DEBIAN libtiff-dev TARGET TIFF::TIFF MODULES libtiff-4)
find_package(PNG QUIET)
set(v2v_png_version ${PNG_VERSION_STRING})
v2v_library(png TITLE "libpng" DEBIAN libpng-dev TARGET PNG::PNG MODULES libpng)

find_package(ZLIB QUIET)
set(v2v_zlib_version ${ZLIB_VERSION_STRING})
v2v_library(zlib TITLE "zlib" DEBIAN zlib1g-dev TARGET ZLIB::ZLIB MODULES zlib)

v2v_library(yaml TITLE "libyaml" DEBIAN libyaml-dev MODULES yaml-0.1 HEADER yaml.h LIBRARIES yaml)
v2v_library(jansson TITLE "jansson" DEBIAN libjansson-dev MODULES jansson
  HEADER jansson.h LIBRARIES jansson)
v2v_library(xml2 TITLE "libxml2" DEBIAN libxml2-dev MODULES libxml-2.0
  HEADER libxml/xmlreader.h SUFFIX libxml2 LIBRARIES xml2)
v2v_library(nlopt TITLE "NLopt" DEBIAN libnlopt-dev MODULES nlopt HEADER nlopt.h LIBRARIES nlopt)
v2v_library(openblas TITLE "OpenBLAS" DEBIAN libopenblas-openmp-dev MODULES openblas
  HEADER cblas.h SUFFIX openblas LIBRARIES openblas)
v2v_library(fftw3f TITLE "FFTW3 in single precision" DEBIAN libfftw3-dev MODULES fftw3f
  HEADER fftw3.h LIBRARIES fftw3f)
v2v_library(fftw TITLE "FFTW3 with MPI and OpenMP in single precision" DEBIAN libfftw3-mpi-dev
  HEADER fftw3-mpi.h LIBRARIES fftw3f_mpi fftw3f_omp)
target_link_libraries(v2v_fftw INTERFACE v2v_fftw3f)

# Debian's package description of oneDNN asks for OpenCL, which nothing here uses. The interface of
# version 3 is another one.
v2v_library(dnnl TITLE "oneDNN 2" DEBIAN libdnnl-dev HEADER oneapi/dnnl/dnnl.h LIBRARIES dnnl)
if(V2V_dnnl_INCLUDE)
  file(STRINGS ${V2V_dnnl_INCLUDE}/oneapi/dnnl/dnnl_version.h lines REGEX "#define DNNL_VERSION_[MP]")
  string(REGEX REPLACE "[^0-9]+" "." v2v_dnnl_version "${lines}")
  string(REGEX REPLACE "^\\.|\\.$" "" v2v_dnnl_version "${v2v_dnnl_version}")
  if(NOT v2v_dnnl_version MATCHES "^2\\.")
    list(APPEND v2v_missing "oneDNN 2: ${V2V_dnnl_INCLUDE} has ${v2v_dnnl_version} (Debian: libdnnl-dev)")
  endif()
endif()
