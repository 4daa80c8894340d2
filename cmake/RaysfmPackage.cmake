# Packages of Debian, made by scripts/package. Three of them, as Debian itself would: whoever runs the program needs neither the
# headers of a dozen libraries nor numpy.
#   raysfm          the program, what it loads when it is needed, manual page, completions
#   libraysfm-dev   headers, static libraries, CMake's files
#   python3-raysfm  the Python package, which shares what raysfm loads
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME raysfm)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
set(CPACK_PACKAGE_CONTACT "raysfm maintainers <raysfm@localhost>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL program development)
if(RAYSFM_PYTHON_FOUND)
  list(APPEND CPACK_COMPONENTS_ALL python)
endif()
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)

set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME raysfm)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION "The program.
 Structure from motion in real time on a CPU, for perspective cameras,
 fisheyes, panoramas, mirrors and rigs, calibrated or not.")

set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libraysfm-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_DEPENDS
    "libeigen3-dev, libopencv-dev, libhwy-dev, libfmt-dev, libyaml-cpp-dev, nlohmann-json3-dev, libbz2-dev, libjpeg-dev, libdeflate-dev, libexif-dev, libsqlite3-dev, libavformat-dev, libavcodec-dev, libavutil-dev, libswscale-dev, libavdevice-dev, pkg-config")
set(CPACK_COMPONENT_DEVELOPMENT_DESCRIPTION "The C++ library.
 Headers and static libraries for CMake's find_package(raysfm).")

set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-raysfm)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
math(EXPR next_minor "${Python_VERSION_MINOR} + 1")
set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
    "raysfm (= ${PROJECT_VERSION}), python3 (>= ${Python_VERSION_MAJOR}.${Python_VERSION_MINOR}), python3 (<< ${Python_VERSION_MAJOR}.${next_minor}), python3-numpy")
# What Python compiles goes with the package.
set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA ${CMAKE_CURRENT_LIST_DIR}/debian/postinst ${CMAKE_CURRENT_LIST_DIR}/debian/prerm)
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "The Python package.
 Camera models, tracking frame by frame and results as numpy arrays.")

foreach(entry program:raysfm development:libraysfm-dev python:python3-raysfm)
  string(REGEX MATCH "^(.*):(.*)$" matched ${entry})
  install(FILES LICENSE DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${CMAKE_MATCH_2} RENAME copyright COMPONENT ${CMAKE_MATCH_1})
endforeach()
include(CPack)
