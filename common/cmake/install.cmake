# Exports every library of common/ as portolan_common::NAME, with headers under include/portolan.

include(CMakePackageConfigHelpers)
get_property(portolan_libraries GLOBAL PROPERTY PORTOLAN_LIBRARIES)
install(TARGETS ${portolan_libraries} EXPORT portolan_commonTargets ARCHIVE DESTINATION lib)
install(EXPORT portolan_commonTargets NAMESPACE portolan_common:: DESTINATION lib/cmake/portolan_common)
install(DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR}/ DESTINATION include/portolan FILES_MATCHING PATTERN "*.h")
configure_package_config_file(cmake/portolan_commonConfig.cmake.in ${CMAKE_CURRENT_BINARY_DIR}/portolan_commonConfig.cmake
  INSTALL_DESTINATION lib/cmake/portolan_common)
portolan_install_version()
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/portolan_commonConfig.cmake DESTINATION lib/cmake/portolan_common)
