"""Prints the compiler flags to embed the running Python in a C program."""

from sysconfig import get_config_var, get_path

folder = get_config_var("LIBDIR")
print(f"-isystem {get_path('include')} -L{folder} -Wl,-rpath,{folder} -lpython{get_config_var('LDVERSION')}")
