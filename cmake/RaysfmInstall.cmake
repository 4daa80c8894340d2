include(CMakePackageConfigHelpers)

get_property(libraries GLOBAL PROPERTY RAYSFM_LIBRARIES)
install(TARGETS ${libraries} EXPORT raysfm-targets
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT development)
install(TARGETS raysfm_program RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT program)
install(DIRECTORY src/raysfm DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT development FILES_MATCHING PATTERN "*.h")
install(EXPORT raysfm-targets NAMESPACE raysfm:: DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/raysfm COMPONENT development)

configure_package_config_file(cmake/raysfm-config.cmake.in
  ${CMAKE_CURRENT_BINARY_DIR}/raysfm-config.cmake
  INSTALL_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/raysfm)
write_basic_package_version_file(${CMAKE_CURRENT_BINARY_DIR}/raysfm-config-version.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/raysfm-config.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/raysfm-config-version.cmake
        DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/raysfm COMPONENT development)
