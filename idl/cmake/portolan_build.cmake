# What every Portolan package builds with: C++17, warnings as errors, sanitizers by one flag, one way to declare
# libraries, executables and tests. Installed by portolan_idl, the first package in the order, and included by its Config.

# Of all packages.
set(PORTOLAN_VERSION 0.1.0)

if(TARGET portolan_flags)
  return()  # a copy of this file at another path was included already
endif()

set(CMAKE_CXX_STANDARD 17)
set(CMAKE_CXX_STANDARD_REQUIRED ON)
set(CMAKE_CXX_EXTENSIONS OFF)
set(CMAKE_POSITION_INDEPENDENT_CODE ON)
set_property(GLOBAL PROPERTY GLOBAL_DEPENDS_NO_CYCLES ON)

if(NOT CMAKE_BUILD_TYPE)
  set(CMAKE_BUILD_TYPE RelWithDebInfo CACHE STRING "" FORCE)
endif()
set(CMAKE_CXX_FLAGS_RELWITHDEBINFO "-O2 -g1" CACHE STRING "" FORCE)

set(PORTOLAN_SANITIZE "" CACHE STRING "Sanitizers: empty, 'address,undefined' or 'thread'")
# x86-64-v2 (2009 and later) has POPCNT, which Hamming distances live on; it leaves Eigen's alignment as Debian's Ceres has it.
if(CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
  set(PORTOLAN_MARCH "x86-64-v2" CACHE STRING "Value of -march")
endif()

# Headers are included by their path below this folder: "geometry/rigid3.h".
if(NOT PORTOLAN_INCLUDE_ROOT)
  set(PORTOLAN_INCLUDE_ROOT ${PROJECT_SOURCE_DIR})
endif()

find_program(PORTOLAN_CCACHE ccache)
if(PORTOLAN_CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${PORTOLAN_CCACHE})
endif()

add_library(portolan_flags INTERFACE)
target_compile_options(portolan_flags INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wnon-virtual-dtor -Werror)
if(PORTOLAN_MARCH)
  add_compile_options(-march=${PORTOLAN_MARCH})
endif()
# A program loads the libraries it uses, not all that those it links might: OpenCV's codecs alone bring a hundred.
add_link_options(-Wl,--as-needed)
set(PORTOLAN_SLOWNESS 1)  # of what runs, by which time limits of tests are multiplied
if(PORTOLAN_SANITIZE)
  set(PORTOLAN_SLOWNESS 5)
  # Instrumented code makes GCC warn of uninitialised values that are none (GCC's manual on -fsanitize).
  add_compile_options(-fsanitize=${PORTOLAN_SANITIZE} -fno-omit-frame-pointer -Wno-maybe-uninitialized)
  add_link_options(-fsanitize=${PORTOLAN_SANITIZE})
  if(PORTOLAN_SANITIZE MATCHES "address")
    add_compile_options(-O1)  # half the time to compile of -O2
  endif()
endif()

# portolan_library(NAME SOURCES a.cc ... DEPENDS lib ...): a static library of this folder, with the package's warnings.
function(portolan_library name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS" ${ARGN})
  add_library(${name} STATIC ${ARG_SOURCES})
  target_link_libraries(${name} PUBLIC ${ARG_DEPENDS} PRIVATE $<BUILD_INTERFACE:portolan_flags>)
  target_include_directories(${name} PUBLIC $<BUILD_INTERFACE:${PORTOLAN_INCLUDE_ROOT}> $<INSTALL_INTERFACE:include/portolan>)
  set_property(GLOBAL APPEND PROPERTY PORTOLAN_LIBRARIES ${name})  # what a package exports
endfunction()

# portolan_executable(NAME SOURCES a.cc ... DEPENDS lib ...): a program, installed into bin/.
function(portolan_executable name)
  cmake_parse_arguments(ARG "" "" "SOURCES;DEPENDS" ${ARGN})
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ${ARG_DEPENDS} portolan_flags)
  install(TARGETS ${name} RUNTIME DESTINATION bin)
endfunction()

# portolan_test(NAME SOURCES a_test.cc ... DEPENDS lib ... [TIMEOUT s] [LABELS l ...]): one GoogleTest program, one CTest entry.
function(portolan_test name)
  cmake_parse_arguments(ARG "" "TIMEOUT" "SOURCES;DEPENDS;LABELS" ${ARGN})
  if(NOT BUILD_TESTING)
    return()
  endif()
  add_executable(${name} ${ARG_SOURCES})
  target_link_libraries(${name} PRIVATE ${ARG_DEPENDS} portolan_flags GTest::gmock_main)
  add_test(NAME ${name} COMMAND ${name} --gtest_output=xml:${CMAKE_BINARY_DIR}/test_results/${name}.xml)
  if(NOT ARG_TIMEOUT)
    set(ARG_TIMEOUT 300)
  endif()
  set_tests_properties(${name} PROPERTIES LABELS "${ARG_LABELS}")
  portolan_limit_test(${name} ${ARG_TIMEOUT})
endfunction()

# portolan_limit_test(NAME s): a CTest entry fails after so many seconds, or longer where a sanitizer slows it.
function(portolan_limit_test name seconds)
  math(EXPR limit "${seconds} * ${PORTOLAN_SLOWNESS}")
  set_tests_properties(${name} PROPERTIES TIMEOUT ${limit})
endfunction()

# portolan_install_version(): lets the packages after it ask for a version, find_package(<project> 0.1).
function(portolan_install_version)
  include(CMakePackageConfigHelpers)
  set(file ${CMAKE_CURRENT_BINARY_DIR}/${PROJECT_NAME}ConfigVersion.cmake)
  write_basic_package_version_file(${file} VERSION ${PORTOLAN_VERSION} COMPATIBILITY SameMinorVersion)
  install(FILES ${file} DESTINATION lib/cmake/${PROJECT_NAME})
endfunction()

# portolan_install_package([HEADERS folder ...] [DEPENDENCIES "find_dependency arguments" ...]): installs the package's libraries and headers, so that
# find_package(<project>) in the packages after it gives targets <project>::<library>. To be called last.
function(portolan_install_package)
  cmake_parse_arguments(ARG "" "" "HEADERS;DEPENDENCIES" ${ARGN})
  get_property(libraries GLOBAL PROPERTY PORTOLAN_LIBRARIES)
  set(config_dir lib/cmake/${PROJECT_NAME})
  set(config "include(CMakeFindDependencyMacro)\n")
  foreach(dependency IN LISTS ARG_DEPENDENCIES)
    string(APPEND config "find_dependency(${dependency})\n")
  endforeach()
  if(libraries)
    install(TARGETS ${libraries} EXPORT ${PROJECT_NAME}Targets ARCHIVE DESTINATION lib)
    install(EXPORT ${PROJECT_NAME}Targets NAMESPACE ${PROJECT_NAME}:: DESTINATION ${config_dir})
    string(APPEND config "include(\${CMAKE_CURRENT_LIST_DIR}/${PROJECT_NAME}Targets.cmake)\n")
  endif()
  file(WRITE ${CMAKE_CURRENT_BINARY_DIR}/${PROJECT_NAME}Config.cmake "${config}")
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/${PROJECT_NAME}Config.cmake DESTINATION ${config_dir})
  portolan_install_version()
  foreach(folder IN LISTS ARG_HEADERS)
    install(DIRECTORY ${folder} DESTINATION include/portolan FILES_MATCHING PATTERN "*.h")
  endforeach()
endfunction()
