# busd_interfaces(TARGET c|cpp PKG/msg/Type...): TARGET can include the headers of these types. `bus` writes them.
function(busd_interfaces target language)
  find_program(BUSD_BUS bus REQUIRED)
  set(folder "${CMAKE_CURRENT_BINARY_DIR}/${target}_types")
  set(suffix_c .h)
  set(suffix_cpp .hpp)
  foreach(type IN LISTS ARGN)
    set(header "${folder}/${type}${suffix_${language}}")
    add_custom_command(OUTPUT "${header}"
      COMMAND "${BUSD_BUS}" interface "${language}" --output "${folder}" "${type}" VERBATIM)
    target_sources("${target}" PRIVATE "${header}")
  endforeach()
  target_include_directories("${target}" PRIVATE "${folder}")
endfunction()
