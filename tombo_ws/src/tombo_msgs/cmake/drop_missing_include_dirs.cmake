# ROS 2 from Python wheels exports targets that name include folders of the image the wheels were
# built in (/opt/python/...), and CMake stops at a folder that does not exist. This drops them from
# all imported targets. On a ROS 2 installed from Debian packages there are none to drop.
function(drop_missing_include_dirs)
  get_property(targets DIRECTORY PROPERTY IMPORTED_TARGETS)
  foreach(target IN LISTS targets)
    get_target_property(dirs ${target} INTERFACE_INCLUDE_DIRECTORIES)
    if(NOT dirs)
      continue()
    endif()
    set(kept ${dirs})
    list(FILTER kept EXCLUDE REGEX "^/opt/python/")
    if(NOT "${kept}" STREQUAL "${dirs}")
      set_target_properties(${target} PROPERTIES INTERFACE_INCLUDE_DIRECTORIES "${kept}")
    endif()
  endforeach()
endfunction()
