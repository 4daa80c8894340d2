# cmake -D PROGRAM=... -D PREFIX=... -D OUT=... -P TestSuites.cmake
#
# Writes what registers the tests of a GoogleTest program with CTest, one CTest test for each suite: tests of a suite
# share what they render, and a process costs more than most tests. Suites of memory have a process for each test.
execute_process(COMMAND ${PROGRAM} --gtest_list_tests OUTPUT_VARIABLE listed COMMAND_ERROR_IS_FATAL ANY)
string(REGEX REPLACE "[;\\[\\]]" "_" listed "${listed}")
string(REPLACE "\n" ";" lines "${listed}")

set(registered "")
# A failure behind the list of what was skipped is a failure.
set(only_skipped [=[\\[  SKIPPED \\] [^\n()]*\n?$]=])
macro(register name)
  string(APPEND registered "add_test(\"${PREFIX}/${name}\" \"${PROGRAM}\" \"--gtest_filter=${filter}\")\n"
                           "set_tests_properties(\"${PREFIX}/${name}\" PROPERTIES TIMEOUT 900 "
                           "SKIP_REGULAR_EXPRESSION \"${only_skipped}\")\n")
endmacro()
foreach(line ${lines})
  string(REGEX REPLACE "  +#.*" "" line "${line}")
  if(line MATCHES "^([^ ].*)\\.$")
    set(suite ${CMAKE_MATCH_1})
    set(filter "${suite}.*")
    if(NOT suite MATCHES "Memory$")
      register(${suite})
    endif()
  elseif(line MATCHES "^  (.+)$")
    set(filter "${suite}.${CMAKE_MATCH_1}")
    if(suite MATCHES "Memory$")
      register(${filter})
    endif()
  endif()
endforeach()
file(WRITE ${OUT} "${registered}")
