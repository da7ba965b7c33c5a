"""What a C compiler needs to embed the Python that runs this."""

from sysconfig import get_config_var, get_path

folder = get_config_var("LIBDIR")
print(f"-isystem {get_path('include')} -L{folder} -Wl,-rpath,{folder} -lpython{get_config_var('LDVERSION')}")
