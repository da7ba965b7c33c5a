# find_package(busd), after `make install`: the target busd::busd, and busd_interfaces().

get_filename_component(_busd_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
if(NOT TARGET busd::busd)
  add_library(busd::busd SHARED IMPORTED)
  set_target_properties(busd::busd PROPERTIES
    IMPORTED_LOCATION "${_busd_prefix}/lib/libbusd.so.0"
    IMPORTED_SONAME libbusd.so.0
    INTERFACE_INCLUDE_DIRECTORIES "${_busd_prefix}/include")
endif()

include("${CMAKE_CURRENT_LIST_DIR}/busdInterfaces.cmake")
