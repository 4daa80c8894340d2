# Writes the manual page and the completions that PROGRAM makes into FOLDER.
file(MAKE_DIRECTORY ${FOLDER})
foreach(entry man:raysfm.1 bash:raysfm zsh:_raysfm)
  string(REGEX MATCH "^(.*):(.*)$" matched ${entry})
  execute_process(COMMAND ${PROGRAM} options ${CMAKE_MATCH_1} OUTPUT_FILE ${FOLDER}/${CMAKE_MATCH_2} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
execute_process(COMMAND gzip -9nf ${FOLDER}/raysfm.1 COMMAND_ERROR_IS_FATAL ANY)
