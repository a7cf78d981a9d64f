# SPDX-License-Identifier: MIT
# find_package(echofuse) defines the target echofuse::recon.
include(CMakeFindDependencyMacro)
find_dependency(Threads)
find_dependency(SQLite3)
find_dependency(BLAS)
find_dependency(LAPACK)
find_dependency(PkgConfig)
pkg_check_modules(DEFLATE REQUIRED IMPORTED_TARGET libdeflate)
pkg_check_modules(HWY REQUIRED IMPORTED_TARGET libhwy)
pkg_check_modules(ISAL REQUIRED IMPORTED_TARGET libisal)
include(${CMAKE_CURRENT_LIST_DIR}/echofuseTargets.cmake)
