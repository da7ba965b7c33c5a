"""What the daemon has as a process: a log, a service manager, a next one to make place for."""
