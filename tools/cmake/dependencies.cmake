# Every outside library, as one target each; a room names the ones it may see.
find_package(PkgConfig REQUIRED)
find_package(OpenMP REQUIRED COMPONENTS C)
pkg_check_modules(MPI REQUIRED IMPORTED_TARGET ompi-c)
pkg_check_modules(HDF5 REQUIRED IMPORTED_TARGET hdf5-openmpi)
pkg_check_modules(TIFF REQUIRED IMPORTED_TARGET libtiff-4)
pkg_check_modules(PNG REQUIRED IMPORTED_TARGET libpng)
pkg_check_modules(YAML REQUIRED IMPORTED_TARGET yaml-0.1)
pkg_check_modules(JANSSON REQUIRED IMPORTED_TARGET jansson)
pkg_check_modules(OPENBLAS REQUIRED IMPORTED_TARGET openblas)
pkg_check_modules(FFTW REQUIRED IMPORTED_TARGET fftw3f)

find_library(FFTW_MPI_LIBRARY fftw3f_mpi REQUIRED)
find_library(FFTW_OMP_LIBRARY fftw3f_omp REQUIRED)
add_library(v2v_fftw INTERFACE)
target_link_libraries(v2v_fftw INTERFACE ${FFTW_MPI_LIBRARY} ${FFTW_OMP_LIBRARY} PkgConfig::FFTW)

# Debian's package description of oneDNN asks for OpenCL, which nothing here uses.
find_library(DNNL_LIBRARY dnnl REQUIRED)
find_path(DNNL_INCLUDE oneapi/dnnl/dnnl.h REQUIRED)
add_library(v2v_dnnl INTERFACE)
target_include_directories(v2v_dnnl INTERFACE ${DNNL_INCLUDE})
target_link_libraries(v2v_dnnl INTERFACE ${DNNL_LIBRARY})
