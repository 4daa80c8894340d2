# raysfm_add_library(FOLDER [APART source...] [DEPENDS target...] [PRIVATE target...] [TEST_DEPENDS target...])
# raysfm_add_library(NAME SOURCES source... [DEPENDS target...] [PRIVATE target...])
#
# One folder of src/raysfm is one library: every .cpp beside the CMakeLists.txt, less the tests and what stands APART,
# which other libraries name as their SOURCES. FOLDER_test holds every *_test.cpp and is registered with CTest.
function(raysfm_add_library folder)
  cmake_parse_arguments(ARG "" "" "SOURCES;APART;DEPENDS;PRIVATE;TEST_DEPENDS" ${ARGN})
  if(ARG_SOURCES)
    set(sources ${ARG_SOURCES})
  else()
    file(GLOB sources CONFIGURE_DEPENDS RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} *.cpp)
    file(GLOB headers CONFIGURE_DEPENDS *.h)
    file(GLOB tests CONFIGURE_DEPENDS *_test.cpp)
    list(FILTER sources EXCLUDE REGEX "_test\\.cpp$")
    list(REMOVE_ITEM sources ${ARG_APART})
  endif()
  if(RAYSFM_SANITIZE)
    raysfm_without_ceres(tests ARG_TEST_DEPENDS)
  endif()
  raysfm_keep_apart(${sources} ${tests})

  set(target raysfm_${folder})
  if(sources)
    add_library(${target} STATIC ${sources} ${headers})
    target_include_directories(${target} PUBLIC $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/src>
                                                $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
    target_link_libraries(${target} PUBLIC ${ARG_DEPENDS} PRIVATE ${ARG_PRIVATE})
    raysfm_compile_options(${target})
  else()
    add_library(${target} INTERFACE)
    target_include_directories(${target} INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/src>
                                                   $<INSTALL_INTERFACE:${CMAKE_INSTALL_INCLUDEDIR}>)
    target_link_libraries(${target} INTERFACE ${ARG_DEPENDS} ${ARG_PRIVATE})
  endif()
  set_target_properties(${target} PROPERTIES EXPORT_NAME ${folder})
  add_library(raysfm::${folder} ALIAS ${target})
  set_property(GLOBAL APPEND PROPERTY RAYSFM_LIBRARIES ${target})

  if(RAYSFM_BUILD_TESTS AND tests)
    add_executable(${folder}_test ${tests})
    target_link_libraries(${folder}_test PRIVATE ${target} ${ARG_TEST_DEPENDS} raysfm_test_support GTest::gtest_main)
    raysfm_compile_options(${folder}_test)
    raysfm_register_suites(${folder}_test ${folder})
  endif()
endfunction()

# The suites of a GoogleTest program as tests PREFIX/suite, known once it is built.
function(raysfm_register_suites target prefix)
  set(suites ${CMAKE_CURRENT_BINARY_DIR}/${target}_suites.cmake)
  add_custom_command(TARGET ${target} POST_BUILD VERBATIM
    COMMAND ${CMAKE_COMMAND} -D PROGRAM=$<TARGET_FILE:${target}> -D PREFIX=${prefix} -D OUT=${suites}
            -P ${PROJECT_SOURCE_DIR}/cmake/TestSuites.cmake)
  file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/${target}_tests.cmake
    "if(EXISTS \"${suites}\")\n  include(\"${suites}\")\nelse()\n  add_test(${prefix}_NOT_BUILT ${prefix}_NOT_BUILT)\nendif()\n")
  set_property(DIRECTORY APPEND PROPERTY TEST_INCLUDE_FILES ${CMAKE_CURRENT_BINARY_DIR}/${target}_tests.cmake)
endfunction()

# raysfm_loads(FOLDER part...): who links the folder's library links these parts of it too, but for a program that sets
# RAYSFM_LOADS_MODULES: that defines their functions itself.
function(raysfm_loads folder)
  foreach(part ${ARGN})
    target_link_libraries(raysfm_${folder} INTERFACE
      $<$<NOT:$<BOOL:$<TARGET_PROPERTY:RAYSFM_LOADS_MODULES>>>:$<TARGET_NAME:raysfm_${part}>>)
  endforeach()
endfunction()

function(raysfm_compile_options target)
  target_compile_options(${target} PRIVATE -Wall -Wextra)
  # GCC 12 sees copies that overlap inside std::string where there are none (GCC bug 105651).
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
    target_compile_options(${target} PRIVATE -Wno-restrict)
  endif()
  if(RAYSFM_WARNINGS_AS_ERRORS)
    target_compile_options(${target} PRIVATE -Werror)
  endif()
  # Sources that are joined look like headers to the compiler.
  if(CMAKE_UNITY_BUILD)
    target_compile_options(${target} PRIVATE -Wno-subobject-linkage)
  endif()
  # Results must not depend on whether the compiler chose to fuse a multiplication and an addition.
  target_compile_options(${target} PRIVATE -ffp-contract=off)
  if(RAYSFM_SANITIZE)
    target_compile_options(${target} PRIVATE -fsanitize=${RAYSFM_SANITIZE} -fno-sanitize-recover=all
                                             -fno-omit-frame-pointer)
    target_link_options(${target} PRIVATE -fsanitize=${RAYSFM_SANITIZE})
    # Under a sanitizer Eigen would lay out its blocks in another way than inside Ceres, which is not built with
    # it but shares functions with the tests.
    target_compile_definitions(${target} PRIVATE EIGEN_MALLOC_ALREADY_ALIGNED=1)
  endif()
endfunction()

# Takes the tests that ask Ceres off a list of them, and Ceres off what they link: it is not built with sanitizers,
# and its copies of Eigen's functions would be mixed with those that are.
function(raysfm_without_ceres tests_name depends_name)
  set(kept)
  foreach(test ${${tests_name}})
    file(STRINGS ${test} oracle REGEX "#include.*ceres" LIMIT_COUNT 1)
    if(NOT oracle)
      list(APPEND kept ${test})
    endif()
  endforeach()
  set(others ${${depends_name}})
  list(REMOVE_ITEM others Ceres::ceres)
  set(${tests_name} ${kept} PARENT_SCOPE)
  set(${depends_name} ${others} PARENT_SCOPE)
endfunction()

# Sources that Highway compiles once per instruction set include themselves and cannot share a translation unit.
function(raysfm_keep_apart)
  foreach(source ${ARGN})
    file(STRINGS ${source} foreach_target REGEX "hwy/foreach_target\\.h" LIMIT_COUNT 1)
    if(foreach_target)
      set_source_files_properties(${source} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
    endif()
  endforeach()
endfunction()
